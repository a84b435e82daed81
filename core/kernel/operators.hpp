#pragma once

#include "time_operator.hpp"

namespace bromwich {

/// The operator for the dynamics of the scene.
std::unique_ptr<TimeOperator> make_time_operator(const DiscreteProblem&);

std::unique_ptr<TimeOperator> make_dense_operator(const DiscreteProblem&);
std::unique_ptr<TimeOperator> make_modal_operator(const DiscreteProblem&);
std::unique_ptr<TimeOperator> make_lag_operator(const DiscreteProblem&);

}  // namespace bromwich

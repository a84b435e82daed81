#pragma once

#include "time_operator.hpp"

namespace bromwich {

/// The operator for the kind of dynamics that the scene has.
std::unique_ptr<TimeOperator> make_time_operator(const DiscreteProblem&);

}  // namespace bromwich

#pragma once

#include "time_operator.hpp"

namespace bromwich {

std::unique_ptr<TimeOperator> make_modal_operator(const DiscreteProblem&);

}  // namespace bromwich

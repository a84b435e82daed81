#pragma once
// Step-by-step methods, the sequential baselines. `march` solves the same discrete problem as the functional iteration
// (exponential, piecewise linear); `euler` is (1.3)-(1.4) of the Laplace-inversion paper.

#include "../kernel/prepared_method.hpp"
#include "../kernel/time_operator.hpp"

namespace bromwich {

/// Marches by the recurrence or the lag weights of the operator for this rule.
std::unique_ptr<PreparedMethod> prepare_march(TimeOperator&, Rule, const Options&);

}  // namespace bromwich

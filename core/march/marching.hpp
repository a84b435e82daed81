#pragma once
// Step by step: the sequential baselines. `march` solves the same discrete problem as the functional iteration
// (exponential, piecewise linear), `euler` is (1.3)-(1.4) of the Laplace-inversion paper.

#include "../kernel/time_operator.hpp"
#include "../result/result.hpp"

namespace bromwich {

/// By the recurrence or the lag weights that the operator has for the rule.
void solve_by_marching(TimeOperator&, Rule, const Options&, Result& result);

}  // namespace bromwich

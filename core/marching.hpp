#pragma once
// Step by step: the sequential baselines. `march` solves the same discrete problem as the functional iteration
// (exponential, piecewise linear), `euler` is (1.3)-(1.4) of the Laplace-inversion paper.

#include "discrete_problem.hpp"
#include "solve.hpp"

namespace bromwich {

void solve_by_marching(const DiscreteProblem&, Rule, const Options&, Result& result);

}  // namespace bromwich

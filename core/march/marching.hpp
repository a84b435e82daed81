#pragma once
// Step by step: the sequential baselines. `march` solves the same discrete problem as the functional iteration
// (exponential, piecewise linear), `euler` is (1.3)-(1.4) of the Laplace-inversion paper.

#include "../kernel/discrete_problem.hpp"
#include "../kernel/sparse_kernel.hpp"
#include "../result/options.hpp"
#include "../result/result.hpp"

namespace bromwich {

/// By a recurrence: dense dynamics and Kronecker sums.
void solve_by_marching(const DiscreteProblem&, Rule, const Options&, Result& result);

/// By lag weights: sparse dynamics, exponential.
void solve_by_marching(const DiscreteProblem&, const SparseKernel&, const Options&, Result& result);

}  // namespace bromwich

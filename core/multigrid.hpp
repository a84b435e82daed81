#pragma once
// Multigrid in time for 0 <= y  ⊥  M y + K y + r >= 0: a full approximation scheme with the functional iteration as its
// smoother. On grid l, with R the values at the points of the coarser grid and I the linear interpolation back:
//
//     smooth          y   <- SOL(M, r + K y)
//     coarse problem  y_c in SOL(M, r_c + K_c y_c),   r_c = R (r + K y) - K_c R y
//     correct         y   <- y + I (y_c - R y)
//     smooth
//
// A solution solves its coarse problem, so that it is left as it is. R has to be injection: averages of y and w over
// time are not complementary where the active set changes. The coarsest grid is marched. The start comes from the
// coarse grids (nested iteration).

#include "solve.hpp"
#include "sparse_kernel.hpp"

namespace bromwich {

/// Fills everything that solve_by_iteration does, cycles and error_estimate too. `kernel`: that of sparse dynamics, or
/// null. Where the grid cannot be halved often enough, it is the functional iteration.
void solve_by_multigrid(const DiscreteProblem&, const SparseKernel* kernel, const Options&, Result&);

}  // namespace bromwich

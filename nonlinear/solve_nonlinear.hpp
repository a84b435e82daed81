#pragma once
// Solves nonlinear complementarity systems, step by step or at all time points at once.
//
// method     what is solved
// march      every step by Josephy-Newton: linear complementarity problems with the Jacobians at the last iterate
// iteration  (5.2): linear systems with frozen A, B, N, M, the rest as sources, on windows of time; prepared once
// newton     Josephy-Newton on a whole window: its linear problem varies in time and is solved by the iteration
// pointwise  the functional iteration: y of all time points from nonlinear complementarity problems with the states of
//            the last sweep, on windows of time; dense matrices
// automatic  march where the linear part has dense matrices, otherwise iteration
//
// All find the same discrete solution: y and phi linear between the time points, order 2 where y is continuous. Windows
// begin with the whole time and are halved where the iteration does not contract; a window of one step goes to march.
// In large scenes march takes windows of one step by newton.

#include "../core/seam/backend.hpp"
#include "nonlinear_options.hpp"
#include "nonlinear_result.hpp"
#include "nonlinear_scene.hpp"

namespace bromwich {

/// Throws Error for bad input; every other outcome is a status. Without phi and gamma the linear scene is solved.
NonlinearResult solve_nonlinear(const NonlinearScene&, Backend&, const NonlinearOptions& = {});

}  // namespace bromwich

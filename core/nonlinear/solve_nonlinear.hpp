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

#include "../result/result.hpp"
#include "../seam/backend.hpp"
#include "nonlinear_options.hpp"
#include "nonlinear_scene.hpp"

#include <optional>
#include <string>

namespace bromwich {

struct NonlinearResult {
  Status status = Status::unsupported;
  std::string reason;  ///< one line if not solved
  Vector t;            ///< J+1
  RowMatrix x, y, w;   ///< (J+1) x m, n, n; NaN after the last valid time. y row 0: of the problem at t = 0
  RowMatrix trace;     ///< (J+1) x n, v = N x, in place of x for NonlinearScene::of_trace of scenes that are not dense
  bool continuous = true;  ///< y is linear between its rows; otherwise it may jump from step to step (Radau IIA)
  double residual = 0;     ///< max |min(y, w)| / max(1, |w - M y|) at the time points
  std::optional<double> error_estimate;  ///< with NonlinearOptions::error
  /// Of the discrete equation of x, relative to max(1, |x|); where the linear part is not dense, the change of the last
  /// linear solve relative to the largest |x| and |y|.
  double defect = 0;
  NonlinearMethod method = NonlinearMethod::automatic;
  Index newton = 0;        ///< Newton iterations in all
  Index solves = 0;        ///< linear solves of windows in all
  Index windows = 0;       ///< that were solved by the iteration
  Index marched = 0;       ///< steps that were marched
  double contraction = 0;  ///< the largest that was seen in an accepted window
};

/// Throws Error for bad input; every other outcome is a status. Without phi and gamma the linear scene is solved.
NonlinearResult solve_nonlinear(const NonlinearScene&, Backend&, const NonlinearOptions& = {});

}  // namespace bromwich

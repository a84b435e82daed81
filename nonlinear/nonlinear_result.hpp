#pragma once

#include "../core/result/result.hpp"
#include "nonlinear_options.hpp"

#include <optional>
#include <string>

namespace bromwich {

/// The result of solve_nonlinear.
struct NonlinearResult {
  Status status = Status::unsupported;
  std::string reason;        ///< one line if not solved
  std::string warning = {};  ///< one line about the accuracy, also if solved; or empty
  Vector t;                  ///< J+1
  RowMatrix x, y, w;         ///< (J+1) x m, n, n; NaN after the last valid time. y row 0: of the problem at t = 0
  RowMatrix trace;  ///< (J+1) x n, v = N x, in place of x for NonlinearScene::of_trace of scenes that are not dense
  RowMatrix y_integral = {};  ///< (J+1) x n, of steps of their own lengths (adapted_nonlinear.hpp); otherwise empty
  double own_error = 0;       ///< the tolerance that these were made for; 0: others
  bool continuous = true;     ///< y is linear between its rows; otherwise it may jump from step to step (Radau IIA)
  double residual = 0;        ///< max |min(y, w)| / max(1, |w - M y|) at the time points
  /// Of x and y, of its mean over [0, t] where y may jump: with NonlinearOptions::error, and where half the step was
  /// solved to confirm a result.
  std::optional<double> error_estimate;
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

}  // namespace bromwich

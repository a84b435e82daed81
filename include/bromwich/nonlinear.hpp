#pragma once
// A nonlinear complementarity system with its linear part apart (Wu, Chen, A parallel iterative algorithm for
// differential linear complementarity problems, (5.1)-(5.2)):
//
//     x' = A x + B y + f(t) + phi(t, x, y),   0 <= y  ⊥  w = N x + M y + g(t) + gamma(t, x, y) >= 0,   x(0) = x0.
//
// The split is free. Terms in A, B, N and M are discretised exactly in time, and the iteration freezes them (W = A).
// Terms in phi and gamma are taken as linear between the time points.
//
// In large scenes phi and gamma may be functions of what the constraints see, v = N x, and phi may enter through B:
//
//     x' = A x + B (y + phi(t, v, y)) + f(t),   0 <= y  ⊥  w = v + M y + g(t) + gamma(t, v, y) >= 0.
//
// Then no array has the size of the states at all time points.

#include "solver.hpp"

#include <functional>
#include <optional>
#include <string>

namespace bromwich {

/// Writes phi (m values, or n through B) or gamma (n values) at t, x (m) or v (n), and y (n).
using NonlinearFunction = std::function<void(double t, const Eigen::Ref<const Vector>& x,
                                             const Eigen::Ref<const Vector>& y, Eigen::Ref<Vector> value)>;
/// Writes the derivatives of phi or gamma by x (m columns) or v (n columns), and by y (n columns).
using NonlinearDerivative =
    std::function<void(double t, const Eigen::Ref<const Vector>& x, const Eigen::Ref<const Vector>& y,
                       Eigen::Ref<Matrix> by_x, Eigen::Ref<Matrix> by_y)>;

struct NonlinearScene {
  Scene linear;                      ///< the linear part, with x0, T, f, g; without E, boundary values and free rows
  NonlinearFunction phi, gamma;      ///< empty: 0
  NonlinearDerivative dphi, dgamma;  ///< empty: by central differences
  bool of_trace = false;             ///< phi and gamma are functions of v = N x, and phi enters through B

  /// Length of the argument x or v of phi and gamma, and of phi: m, or n with of_trace.
  Index seen() const { return of_trace ? linear.constraints() : linear.states(); }

  /// As Scene::validate; throws Error too for a mass matrix, boundary values and free rows.
  void validate() const;
};

enum class NonlinearMethod { automatic, march, iteration, newton, pointwise };

/// "automatic", "march", ...
const char* to_string(NonlinearMethod);

struct NonlinearOptions {
  NonlinearMethod method = NonlinearMethod::automatic;
  Index steps = 0;                   ///< J; 0: as Options::steps, by the linear part
  double tolerance = 1e-12;          ///< of the last change, relative to the largest |y| and |x|
  Index most_newton = 30;            ///< Newton iterations of a step or window
  Index most_iterations = 200;       ///< linear solves of a window
  Method inner = Method::automatic;  ///< of the linear solves
  /// Error of x and y, of the mean of y where it may jump, relative to the largest value of each component; steps are
  /// halved until it is reached. 0: one grid, if steps are given.
  double error = 0;
  Index max_steps = Index(1) << 18;  ///< of the finest grid
  /// Of one grid: half the step confirms a result of which its own steps raise doubts.
  bool confirm = true;
  bool concurrent = false;  ///< several threads may call phi, gamma and their derivatives at once
  std::function<bool()> interrupted = {};
};

/// The result of solve_nonlinear.
struct NonlinearResult {
  Status status = Status::unsupported;
  std::string reason;        ///< one line if not solved
  std::string warning = {};  ///< one line about the accuracy, also if solved; or empty
  Vector t;                  ///< J+1
  RowMatrix x, y, w;         ///< (J+1) x m, n, n; NaN after the last valid time. y row 0: of the problem at t = 0
  RowMatrix trace;  ///< (J+1) x n, v = N x, in place of x for NonlinearScene::of_trace of scenes that are not dense
  RowMatrix y_integral = {};  ///< (J+1) x n, of steps of their own lengths; otherwise empty
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

/// Throws Error for bad input; every other outcome is a status. Without phi and gamma the linear scene is solved.
NonlinearResult solve_nonlinear(const NonlinearScene&, Backend&, const NonlinearOptions& = {});

}  // namespace bromwich

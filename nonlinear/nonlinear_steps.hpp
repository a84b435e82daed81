#pragma once
// The discrete problem of a nonlinear scene on one time grid, and its solution step by step by Josephy-Newton.
//
// With X the states and Y at the nodes of a step, R(X, Y) = X - (E x_0 + s + L F_0 + W F) and F = B Y + phi(X, Y),
// every iteration solves
//
//     R + R_X dX + R_Y dY = 0,   0 <= Y + dY  ⊥  w + (N + gamma_x) dX + (M + gamma_y) dY >= 0
//
// for dX, which leaves one linear complementarity problem in Y (Josephy 1979; Robinson, Math. Oper. Res. 5, 1980).

#include "../core/seam/backend.hpp"
#include "exponential_step.hpp"
#include "nonlinear_scene.hpp"

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// The outcome of Newton's iteration.
struct NewtonOutcome {
  bool solved = false;
  Index iterations = 0;
  double change = 0;       ///< of the last iteration
  std::string why = {};    ///< it ended before the limit of iterations without a solution
  bool nonfinite = false;  ///< phi or gamma is not finite where the step begins
};

/// What the linear part does in one step: its matrices, ∫ e^{(c_i h - s) A} f ds of all nodes (nodes m), and g there.
struct StepData {
  const ExponentialStep& rule;
  double begin;
  std::vector<double> times;  ///< of the nodes
  Vector increments;
  std::vector<Vector> g;
};

class NonlinearSteps {
 public:
  /// J steps. The linear part of the sources is integrated by the engine of linear scenes.
  NonlinearSteps(const NonlinearScene&, Backend&, Index J, StepRule, double tolerance, Index most_newton);

  /// y of 0 <= y ⊥ N x + M y + g + gamma >= 0 at t_j, from the guess y.
  NewtonOutcome y_at(Index j, const Vector& x, Vector& y) const;
  /// From x, y at t_{j-1} to those at t_j.
  NewtonOutcome take(Index j, Vector& x, Vector& y);
  /// Over any step. `Y`: y at all nodes.
  NewtonOutcome take(const StepData&, Vector& x, Vector& y, Vector& Y);

  /// The residual of the equation of x for x and y at t_{j-1} and t_j; rule linear.
  Vector defect(Index j, const Vector& x0, const Vector& y0, const Vector& x1, const Vector& y1) const;

  Vector total_source(double t, const Vector& x, const Vector& y) const;  ///< F = B y + phi
  Vector g(double t) const;
  /// x_j from x_{j-1} and F at both ends; rule linear.
  Vector carry(Index j, const Vector& x0, const Vector& F0, const Vector& F1) const;

  /// The largest |x|, |y| and term of w so far, to which changes are relative.
  std::array<double, 3> sizes() const { return {size_x_, size_y_, size_w_}; }
  void set_sizes(const std::array<double, 3>& xyw) { size_x_ = xyw[0], size_y_ = xyw[1], size_w_ = xyw[2]; }

  void select_least() { least_ = true; }
  bool selects_least() const { return least_; }

  double time(Index j) const { return double(j) * h_; }
  /// Of M + gamma_y at t = 0: P or Z where y is continuous.
  LcpClass lcp_class(const Vector& x, const Vector& y) const;

 private:
  /// The equations of a step, linearized at (X, Y): R, w and their derivatives.
  struct Equations;
  Equations equations(const StepData&, const Vector& X, const Vector& Y, const Vector& known) const;
  bool solve_lcp(const Matrix& M, const Matrix& of_y, const Vector& q, Vector& y) const;

  const NonlinearScene* scene_;
  Matrix A_, B_, N_, M_;
  double h_;
  double tolerance_;
  Index most_newton_;
  bool least_ = false;                           ///< the least element is selected: class Z
  mutable std::optional<LcpClass> class_;        ///< of the last matrix that was examined
  double size_x_ = 0, size_y_ = 0, size_w_ = 0;  ///< the largest values so far
  ExponentialStep step_;
  RowMatrix increments_;  ///< s_i: row (j - 1) nodes + i of step j
};

}  // namespace bromwich

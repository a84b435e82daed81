#pragma once
// Derivatives of a solution with respect to its data, with a continuous y. The dynamics are written out as dense
// matrices, with E x' = A x + ... as x' = E^{-1} A x + ...
//
// The discrete solution is y linear between time points, u_j = B y_j + f_j, and
//
//     x_j = ξ_j + R u_j,   ξ_j = E x_{j-1} + L u_{j-1},   E = e^{hA}, L = h (phi_1 - phi_2)(hA), R = h phi_2(hA),
//     w_j = N x_j + M y_j + g_j,   (w_j)_S = 0,   (y_j)_i = 0 for i not in S,   S = S_j = {i : (y_j)_i > 0}.
//
// Where no component has y_i = w_i = 0, small changes of the data leave the sets S_j as they are, and y, x and w are
// differentiable. With W = M + N R B a change of the data gives
//
//     dy_S = -W_SS^{-1} (N dξ + dN x + dM y + dg)_S,   dξ_j = E dx_{j-1} + L du_{j-1} + dE x_{j-1} + dL u_{j-1} + ...
//
// (jvp: one pass forward), and a linear function of y, x and w has the gradient that one pass backward gives (vjp):
//
//     p_j = x̄_j + E^T q_{j+1},   (μ_j)_S = W_SS^{-T} (ȳ_j + B^T R^T p_j + B^T L^T q_{j+1})_S,   q_j = p_j - N^T μ_j,
//
// with ḡ_j = -μ_j, f̄_j = R^T q_j + L^T q_{j+1}. Derivatives of E, L and R with respect to A are blocks of the same
// functions of [[A, dA], [0, A]] (Higham, Functions of Matrices, theorem 3.6).

#include "../core/result/result.hpp"
#include "../core/scene/scene.hpp"
#include "set_margin.hpp"
#include "set_responses.hpp"

#include <string>
#include <vector>

namespace bromwich {

/// A change of the data, or a gradient with respect to it. Empty: no change, or in a gradient no rows.
struct DataChange {
  Vector x0;       ///< m
  RowMatrix f, g;  ///< (J+1) x m and (J+1) x n: at the time points, linear between them
  Matrix A, B, N, M;
  Matrix E = {};            ///< where the scene has a mass matrix
  Vector b = {};            ///< m, where the scene has a boundary condition
  Matrix E0 = {}, ET = {};  ///< m x m, likewise
};

/// A time at which f or g jumps, and how it changes.
struct MovingJump {
  double t = 0, change = 0;
};

/// Leaves out of a gradient what moves w(0) = N x0 + M y_0 + g_0: x0, g, N unless x0 is 0, and M unless y_0 is.
void leave_out_start(DataChange& gradient, const Vector& x0, const RowMatrix& y);

/// y, x and w at the time points, or a linear function of them: (J+1) x n, m, n. Empty: no part in the function.
struct SolutionChange {
  RowMatrix y, x, w;
  RowMatrix integral;  ///< (J+1) x n: of y over [0, t_j], impulses included
};

/// Whether y of the result may jump: SolutionDerivative refuses it, SwitchedDerivative
/// (derivatives/switched_derivative.hpp) takes its scene.
bool y_may_jump(const Result&);

class SolutionDerivative {
 public:
  /// The result must be of this scene, on a grid of equal steps, by `march`, `contour` or `multigrid`. Throws Error if
  /// it is not solved, or if y may jump: the derivative of the discrete solution is then not that of the solution.
  /// Throws Error, too, if a degenerate component (y_i = w_i = 0) leaves only one-sided derivatives, or if the scene is
  /// too large for dense matrices.
  SolutionDerivative(const Scene&, const Result&);

  Index steps() const { return J_; }
  const DerivativeMargin& margin() const { return margin_; }
  const Vector& times() const { return t_; }
  const RowMatrix& states() const { return x_; }  ///< (J+1) x m

  SolutionChange jvp(const DataChange&) const;
  /// The gradient with respect to all data; its f has m columns, also if the scene states f = F phi.
  DataChange vjp(const SolutionChange&) const;

 private:
  void follow(const Result&);
  void check_start(const SolutionChange&, const RowMatrix& fixed) const;

  DataChange without_mass(DataChange) const;
  void add_mass(DataChange&) const;

  DenseDynamics d_;   ///< with E = I
  Matrix inverse_E_;  ///< of the scene; empty: E = I
  RowMatrix f_;       ///< (J+1) x m, in x' = ... + f
  Matrix M_, E_, L_, R_;
  Index J_ = 0, m_ = 0, n_ = 0;
  double h_ = 0;
  Vector t_;
  RowMatrix y_, x_, u_, w_;
  SetResponses responses_;        ///< of W, and of M at t = 0
  std::vector<Index> sets_;       ///< S_j, as the index of its response
  std::vector<Index> undecided_;  ///< undecided_at_start
  DerivativeMargin margin_;
};

}  // namespace bromwich

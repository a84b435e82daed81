#pragma once
// Derivatives of the discrete solution of a Kronecker sum with a continuous y, with respect to x0, to sources that
// enter through B, to g and to M. As derivatives/solution_derivative.hpp, with its equations in the modes of A,
// where time is a convolution for each mode of the face (derivatives/modal_convolution.hpp): nothing of size m x m
// is formed. States at time points are formed on request, from all modes.
//
// symbol  variable   shape   meaning
// x^      K x n      modes of the state: k across, l of the face
// u^      n          modes of y + phi, f = B phi
//     w = S (n^^T e^{At} x0^ + K u^) + g + M y,   K: W_0 at the same time;   W = M + S diag(W_0) S.

#include "../core/result/result.hpp"
#include "../core/scene/scene.hpp"
#include "kronecker_states.hpp"
#include "modal_convolution.hpp"
#include "modal_start.hpp"
#include "solution_derivative.hpp"

#include <utility>
#include <vector>

namespace bromwich {

class ModalDerivative {
 public:
  /// The result must be of this scene, on a grid of equal steps, by march, contour or multigrid, with y linear between
  /// the time points. Throws Error as SolutionDerivative does, for dynamics other than Kronecker sums, and for sources
  /// of the state that do not enter through B.
  ModalDerivative(const Scene&, const Result&);
  ModalDerivative(const ModalDerivative&) = delete;
  ModalDerivative& operator=(const ModalDerivative&) = delete;

  Index steps() const { return J_; }
  const DerivativeMargin& margin() const { return margin_; }

  /// Members x0 (m), f ((J+1) x n, through B), g ((J+1) x n) and M (n x n); others throw Error. x of what is returned
  /// is empty, or (J+1) x m with `states`.
  SolutionChange jvp(const DataChange&, bool states = false) const;
  /// x of the function may be empty or (J+1) x m. The gradient has the members x0, f through B, g and M.
  DataChange vjp(const SolutionChange&) const;

  /// The same for a change of the parameters of the sum. It takes all modes of the state, K x n at each time point.
  SolutionChange jvp(const KroneckerChange&, bool states = false) const;
  /// The derivative in this direction of the function `of`, whose gradient vjp gave.
  double along(const KroneckerChange&, const SolutionChange& of, const DataChange& gradient) const;

 private:
  SolutionChange with_y_held(const KroneckerChange&, bool states) const;
  struct Pass;
  void step_forward(Pass&, SolutionChange&) const;
  void step_backward(Pass&, const SolutionChange& of, const RowMatrix& given, Vector& later, DataChange&) const;
  Vector follow(const RowMatrix& x0, const RowMatrix& u);

  KroneckerDynamics d_;
  LcpMatrix scene_M_, transposed_M_;
  Matrix M_;
  Index J_ = 0, m_ = 0, n_ = 0;
  double h_ = 0;
  Vector t_, seen_;  ///< seen_: n^, K
  KroneckerStates states_;
  const FaceModes& face_;  ///< of states_
  ModalConvolution convolution_;
  ModalStart start_;
  std::vector<Index> every_;  ///< 0, 1, ..., n - 1
  RowMatrix y_, w_, u_;       ///< u_: y + phi
  Vector x0_;
  SetResponses responses_;  ///< of W, and of M at t = 0
  std::vector<Index> sets_;
  std::vector<Index> undecided_;  ///< undecided_at_start
  DerivativeMargin margin_;
};

}  // namespace bromwich

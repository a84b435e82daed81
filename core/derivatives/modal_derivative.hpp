#pragma once
// Derivatives of the discrete solution of a Kronecker sum with a continuous y, with respect to x0, to sources that
// enter through B, to g and to M. As core/derivatives/solution_derivative.hpp, with its equations in the modes of A,
// where e^{hA}, L and R are numbers: nothing of size m x m is formed, and one state is kept at a time.
//
// symbol  variable   shape   meaning
// x^      K x n      modes of the state: k across, l of the face
// u^      n          modes of y + phi, f = B phi
// E, Lb,  K x n      e^z, h b^_k (phi_1 - phi_2)(z) and h b^_k phi_2(z), z = h (mu_l + nu_k)
// Rb
//     x^_j = E x^_{j-1} + Lb u^_{j-1} + Rb u^_j,   v_j = S (n^^T x^_j),   W = M + S diag(n^^T Rb) S.

#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "solution_derivative.hpp"

#include <vector>

namespace bromwich {

class ModalDerivative {
 public:
  /// The result must be of this scene, on a grid of equal steps, by march, contour or multigrid, with y linear between
  /// the time points. Throws Error as SolutionDerivative does, for dynamics other than Kronecker sums, and for sources
  /// of the state that do not enter through B.
  ModalDerivative(const Scene&, const Result&);

  Index steps() const { return J_; }
  const DerivativeMargin& margin() const { return margin_; }

  /// Members x0 (m), f ((J+1) x n, through B), g ((J+1) x n) and M (n x n); others throw Error. x of what is returned
  /// is empty, or (J+1) x m with `states`.
  SolutionChange jvp(const DataChange&, bool states = false) const;
  /// x of the function may be empty or (J+1) x m. The gradient has the members x0, f through B, g and M.
  DataChange vjp(const SolutionChange&) const;

 private:
  RowMatrix state_modes(const Vector& x) const;
  Vector state_of(const RowMatrix& modes) const;
  void to_modes(double* values) const;
  Vector face_modes(Vector v) const;
  Vector see(const RowMatrix& modes) const;
  void follow(const Result&, const RowMatrix& phi);
  void check(const char* name, Index rows, Index columns, Index expected_rows, Index expected_columns) const;

  KroneckerDynamics d_;
  Matrix M_, across_;          ///< across_: modes of one line in its columns
  std::vector<Matrix> sines_;  ///< of the directions of the face
  Index J_ = 0, m_ = 0, n_ = 0, K_ = 0;
  double h_ = 0;
  Vector t_, seen_;        ///< seen_: n^, K
  RowMatrix E_, Lb_, Rb_;  ///< K x n
  RowMatrix x0_;           ///< of the scene, in modes
  RowMatrix y_, w_;
  SetResponses responses_;  ///< of W, and of M at t = 0
  std::vector<Index> sets_;
  DerivativeMargin margin_;
};

}  // namespace bromwich

#pragma once
// v = N x of the states that u drives in a Kronecker sum, step by step in modes, and the transposed operation backwards
// in time. With a recurrence of K exponentials a mode (core/seam/recurrence.hpp), G = 1 for j >= 1:
//
//     v_j = W_0 u_j + a_j,      a_j = w1 u_{j-1} + Σ_k C z_{j-1},      z_j = E z_{j-1} + G u_j,      v_0 = 0,
//     (K^T ρ)_j = W_0 ρ_j + b_j,      b_j = w1 ρ_{j+1} + Σ_k G ζ_j,      ζ_j = E ζ_{j+1} + C ρ_{j+1}.
//
// Long lines take a short sum of exponentials in place of their eigenvalues (core/kernel/compression.hpp), as marching
// does. x0 takes all eigenvalues: Σ_k n^_k e^{t (mu + nu_k)} x^0_k, sixteen time points at a time.

#include "../dynamics/dynamics.hpp"
#include "../seam/recurrence.hpp"

namespace bromwich {

class ModalConvolution {
 public:
  ModalConvolution(const KroneckerDynamics&, double h, double T);

  const Vector& own() const { return r_.w0; }  ///< W_0, n
  Index exponentials() const { return r_.exponentials(); }

  /// z or ζ; columns are filled up to whole vectors.
  struct State {
    RowMatrix values;    ///< K x n
    Vector given, made;  ///< n: what comes in, and what goes out
  };
  State state() const;  ///< zero
  /// From z_{j-2} to z_{j-1}, and a_j. j = 1, 2, ...
  void advance(Index j, const double* u_before, State& z, Vector& a) const;
  /// From ζ_{j+1} to ζ_j, and b_j. j = J - 1, J - 2, ..., 0; j = 0 has no W_0.
  void retreat(Index j, const double* rho_after, State& zeta, Vector& b) const;

 private:
  ModalRecurrence r_;  ///< tables and weights of lag 1 filled up likewise
};

/// The response to x0 in modes.
class ModalStart {
 public:
  ModalStart(const KroneckerDynamics&, double h);
  /// `x0`: K x n, modes. (J+1) x n.
  RowMatrix response(const RowMatrix& x0, Index J) const;
  /// The transposed: `rho` (J+1) x n, the result K x n.
  RowMatrix transposed(const RowMatrix& rho) const;

 private:
  Index n_;
  Vector seen_;      ///< K, n^
  RowMatrix decay_;  ///< K x n, e^{h (mu + nu_k)}, columns filled up to whole vectors
  RowMatrix
      ends_;  ///< K x vectors of columns: rows of time points from which on the powers of all their entries vanish
};

}  // namespace bromwich

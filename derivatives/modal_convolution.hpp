#pragma once
// v = N x of the states that u drives in a Kronecker sum, step by step in modes. With a recurrence of K exponentials a
// mode (core/seam/recurrence.hpp), G = 1 for j >= 1:
//
//     v_j = W_0 u_j + a_j,      a_j = w1 u_{j-1} + Σ_k C z_{j-1},      z_j = E z_{j-1} + u_j,      z_0 = G0 u_0,   v_0
//     = 0,
//
// and the transposed operation is the same in reversed time, but for its last row:
//
//     (K^T ρ)_j = W_0 ρ_j + b_j,      b_j = w1 ρ_{j+1} + Σ_k C ζ_{j+1},      ζ_j = E ζ_{j+1} + ρ_j,
//     b_0 = s1 ρ_1 + Σ_k C G0 ζ_1.
//
// The exponentials move four time points at a time, since reading them costs more than the arithmetic. In between the
// last values enter by their lag weights W_d, and all before them by Σ_k C E^i z. Long lines take a short sum of
// exponentials in place of their eigenvalues (core/kernel/compression.hpp), as marching does.
//
// Vectors of modes have `width` entries: n, filled up with zeros to whole vectors.

#include "../core/dynamics/dynamics.hpp"
#include "../core/seam/recurrence.hpp"

namespace bromwich {

class ModalConvolution {
 public:
  ModalConvolution(const KroneckerDynamics&, double h, double T);

  const Vector& own() const { return own_; }  ///< W_0, n
  Index width() const { return decay_.size() / K_; }
  Index exponentials() const { return K_; }

  /// z or ζ, with the values that came after it.
  struct State {
    Vector values;    ///< K exponentials of one vector of modes behind those of the vector before
    RowMatrix later;  ///< values behind z, `waiting` rows
    RowMatrix older;  ///< row i: Σ_k C E^i z
    Index waiting = 0;
  };
  State state() const;  ///< zero
  /// a_1 from u_0.
  void start(const double* u, State& z, double* a) const;
  /// a_{j+1} from u_j, j = 1, 2, ...; b_{j-1} from ρ_j, j = J, J - 1, ..., 2.
  void advance(const double* u, State& z, double* a) const;
  /// b_0 from ρ_1.
  void finish(const double* rho, const State& zeta, double* b) const;

 private:
  Index K_ = 0;
  Vector own_;
  Vector decay_, output_, start_;  ///< E, C and G0, in the order of State::values
  RowMatrix lags_;                 ///< row d: W_{d+1}
  Vector w1_, s1_;
};

}  // namespace bromwich

#pragma once
// The states of a Kronecker sum at all time points (derivatives/state_maps.hpp), in the modes of A: x^ is K x n, k
// across and l of the face, and e^{hA}, L B and R B are K x n numbers.

#include "../core/dynamics/dynamics.hpp"
#include "face_modes.hpp"

#include <utility>

namespace bromwich {

/// A change of the parameters of a Kronecker sum.
struct KroneckerChange {
  double face = 0, across = 0;   ///< of the diffusivities of the face and of the lines across it, relative
  double decay = 0;              ///< of the sum of all decay rates, 1/time
  double input = 0, output = 0;  ///< of b and n, relative
};

class KroneckerStates {
 public:
  KroneckerStates(const KroneckerDynamics&, double h);

  const FaceModes& face() const { return face_; }
  /// K x n modes of m values.
  RowMatrix modes_of(const Vector& x) const;
  Vector state_of(RowMatrix modes) const;

  /// `x0`: modes, or empty; `u`: (J+1) x n, modes. (J+1) x m.
  RowMatrix states(const RowMatrix& x0, const RowMatrix& u) const;
  /// The transposed: with respect to u, (J+1) x n in modes, and to x0, K x n.
  std::pair<RowMatrix, RowMatrix> transposed(const RowMatrix& of_x) const;
  /// The change of N x, (J+1) x n in modes, that a change of the dynamics causes where x0 and u stay, and with `states`
  /// that of x, (J+1) x m.
  RowMatrix change(const KroneckerChange&, const RowMatrix& x0, const RowMatrix& u, RowMatrix* states) const;

 private:
  KroneckerDynamics d_;
  FaceModes face_;
  Matrix across_;  ///< modes of one line in its columns
  Index n_, K_;
  double h_;
  RowMatrix E_, Lb_, Rb_;  ///< e^z, h b^_k (phi_1 - phi_2)(z) and h b^_k phi_2(z), z = h (mu_l + nu_k)
};

}  // namespace bromwich

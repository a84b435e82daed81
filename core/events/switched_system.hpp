#pragma once
// A, B, N and M of a scene as located events take them.

#include "../scene/scene.hpp"
#include "mode.hpp"

#include <Eigen/LU>

namespace bromwich {

/// h |(I - hA)^{-1} V|: how far constant inputs, the columns of V, move the states within h. Fast modes that decay
/// count with the states to which they tend.
inline Matrix motion_within(double h, const Matrix& A, const Matrix& V) {
  if (A.rows() == 0) return V.cwiseAbs();
  const Matrix moved = Matrix(Matrix::Identity(A.rows(), A.rows()) - h * A).partialPivLu().solve(V);
  return h * (moved.allFinite() ? moved : V).cwiseAbs();
}

/// Of a scene with dense dynamics. Entries of M up to the rounding of what y moves in N x within T,
/// 64 eps |N| T |(I - TA)^{-1} B|, are zero: what a reduction of larger equations leaves of zeros. M y is rounding of w
/// then, and would decide signs of y all the same.
inline SystemMatrices switched_system(const Scene& scene) {
  const DenseDynamics& d = *scene.dynamics->small_state();
  SystemMatrices s{d.A, d.B, d.N, to_dense(scene.M), scene.restitution};
  const Matrix moves = s.N.cwiseAbs() * motion_within(scene.T, s.A, s.B);
  s.M = (s.M.cwiseAbs().array() > 64 * epsilon * moves.array()).select(s.M, 0.0);
  return s;
}

}  // namespace bromwich

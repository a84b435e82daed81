#pragma once
// A, B, N and M of a scene as located events take them.

#include "../scene/scene.hpp"
#include "mode.hpp"

#include <Eigen/LU>

#include <algorithm>

namespace bromwich {

/// h |(I - hA)^{-1} v|: how far constant inputs v move the states within h. Fast modes that decay count with the states
/// to which they tend. Where A magnifies much, this says nothing: 0.
inline Vector motion_within(double h, const Matrix& A, const Vector& v) {
  constexpr double much = 1e6;
  const Matrix inverse = Matrix(Matrix::Identity(A.rows(), A.rows()) - h * A).partialPivLu().inverse();
  if (!(inverse.cwiseAbs().sum() <= much)) return Vector::Zero(v.size());
  return h * (inverse * v).cwiseAbs();
}

/// Of a scene with dense dynamics. Entries of M up to the rounding of what y moves in N x within the time h of the
/// fastest mode, 64 eps h |N| |B| with h = min(T, 1 / |A|), are zero: what a reduction of larger equations leaves of
/// zeros. M y is rounding of w then, and would decide signs of y all the same.
inline SystemMatrices switched_system(const Scene& scene) {
  const DenseDynamics& d = *scene.dynamics->small_state();
  SystemMatrices s{d.A, d.B, d.N, to_dense(scene.M), scene.restitution};
  if (s.states() == 0) return s;
  const double rate = s.A.cwiseAbs().rowwise().sum().maxCoeff(), h = std::min(scene.T, 1 / std::max(rate, 1e-290));
  const Matrix moves = h * (s.N.cwiseAbs() * s.B.cwiseAbs());
  s.M = (s.M.cwiseAbs().array() > 64 * epsilon * moves.array()).select(s.M, 0.0);
  return s;
}

}  // namespace bromwich

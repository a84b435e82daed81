#pragma once
// A, B, N and M of a scene as located events take them.

#include "../numerics/equilibration.hpp"
#include "../scene/scene.hpp"
#include "mode.hpp"

#include <Eigen/LU>

namespace bromwich {

/// Of a scene with dense dynamics. Entries of M up to the rounding of what y moves in N x within T,
/// 64 eps |N| T |(I - TA)^{-1}| |B|, are zero: what a reduction of larger equations leaves of zeros. M y is rounding of
/// w then, and would decide signs of y all the same.
inline SystemMatrices switched_system(const Scene& scene) {
  constexpr double regular = 1e-8;
  const DenseDynamics& d = *scene.dynamics->small_state();
  SystemMatrices s{d.A, d.B, d.N, to_dense(scene.M), scene.restitution};
  const Eigen::PartialPivLU<Matrix> lu(Matrix(Matrix::Identity(s.states(), s.states()) - scene.T * s.A));
  if (s.states() == 0 || s.constraints() == 0 || !(reciprocal_condition(lu) > regular)) return s;
  const Matrix moves = scene.T * (s.N.cwiseAbs() * lu.inverse().cwiseAbs() * s.B.cwiseAbs());
  s.M = (s.M.cwiseAbs().array() > 64 * epsilon * moves.array()).select(s.M, 0.0);
  return s;
}

}  // namespace bromwich

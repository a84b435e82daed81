#pragma once
// A, B, N and M of a scene as located events take them.

#include "../scene/scene.hpp"
#include "mode.hpp"

#include <algorithm>

namespace bromwich {

/// Of a scene with dense dynamics, and its guards(). Entries of M that move w by less than 1e-12 of N x within the time
/// of the fastest mode are zero: what a reduction of larger equations leaves of zeros. The finest integration does not
/// see them in w, and they would decide signs of y all the same.
inline SystemMatrices switched_system(const Scene& scene, Index guards) {
  const DenseDynamics& d = *scene.dynamics->small_state();
  SystemMatrices s{d.A, d.B, d.N, to_dense(scene.M), scene.restitution, guards};
  if (s.states() == 0) return s;
  const double rate = s.A.cwiseAbs().rowwise().sum().maxCoeff(), h = std::min(scene.T, 1 / std::max(rate, 1e-290));
  const Matrix moves = h * (s.N.cwiseAbs() * s.B.cwiseAbs());
  s.M = (s.M.cwiseAbs().array() > 1e-12 * moves.array()).select(s.M, 0.0);
  return s;
}

}  // namespace bromwich

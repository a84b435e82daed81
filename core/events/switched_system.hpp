#pragma once
// A, B, N and M of a scene as located events take them.

#include "../scene/scene.hpp"
#include "mode.hpp"

#include <algorithm>

namespace bromwich {

/// Of a scene with dense dynamics, and its guards(). Entries of M up to the rounding of what y moves in N x within the
/// time h of the fastest mode, 64 eps h |N| |B| with h = min(T, 1 / |A|), are zero: what a reduction of larger
/// equations leaves of zeros. M y is rounding of w then, and would decide signs of y all the same.
inline SystemMatrices switched_system(const Scene& scene, Index guards) {
  const DenseDynamics& d = *scene.dynamics->small_state();
  SystemMatrices s{d.A, d.B, d.N, to_dense(scene.M), scene.restitution, guards};
  if (s.states() == 0) return s;
  const double rate = s.A.cwiseAbs().rowwise().sum().maxCoeff(), h = std::min(scene.T, 1 / std::max(rate, 1e-290));
  const Matrix moves = h * (s.N.cwiseAbs() * s.B.cwiseAbs());
  s.M = (s.M.cwiseAbs().array() > 64 * epsilon * moves.array()).select(s.M, 0.0);
  return s;
}

}  // namespace bromwich

#pragma once
// A scalar scene on which the functional iteration cannot contract at h = 1.

#include "core/scene/scene.hpp"

namespace bromwich {

/// A = -1, B = 1, N = 10, M = 1: L ||W_0|| = 10 phi2(-1) = 3.7 at h = 1, so Theorem 2.3 (1) of the paper on Laplace
/// inversion cannot hold.
inline Scene expanding() {
  Scene scene;
  scene.name = "expanding";
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{10}}};
  scene.M = Matrix{{1}};
  scene.g = [](double, Eigen::Ref<Vector> g) { g[0] = -1; };
  scene.x0 = Vector::Zero(1);
  scene.T = 8;
  return scene;
}

}  // namespace bromwich

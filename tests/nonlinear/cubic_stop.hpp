#pragma once

#include "nonlinear/nonlinear_scene.hpp"

#include <cmath>

namespace bromwich {

using In = const Eigen::Ref<const Vector>&;

/// An oscillator with a cubic spring, driven against a stop with compliance 1/5: q'' = -q - q^3 - q'/5 + 2 cos 2t + y,
/// w = q + 1/2 + y/5.
inline NonlinearScene cubic_stop() {
  NonlinearScene s;
  s.linear.dynamics = DenseDynamics{Matrix{{0, 1}, {-1, -0.2}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  s.linear.M = Matrix{{0.2}};
  s.linear.f = [](double t, Eigen::Ref<Vector> v) { v << 0, 2 * std::cos(2 * t); };
  s.linear.g = [](double, Eigen::Ref<Vector> v) { v[0] = 0.5; };
  s.linear.x0 = Vector{{0.3, 0}};
  s.linear.T = 6;
  s.phi = [](double, In x, In, Eigen::Ref<Vector> v) { v << 0, -std::pow(x[0], 3); };
  s.dphi = [](double, In x, In, Eigen::Ref<Matrix> by_x, Eigen::Ref<Matrix> by_y) {
    by_x.setZero();
    by_y.setZero();
    by_x(1, 0) = -3 * x[0] * x[0];
  };
  return s;
}

}  // namespace bromwich

// A suspension bridge whose cables pull but do not push (Zill's model), as an initial-value problem:
//
//     x'' + 4 max(x,0) - max(-x,0) = sin 4t,   x(0) = 0,   x'(0) = nu.
//
// With y = max(-x,0) this is x'' = -4x - 3y + sin 4t and 0 <= y ⊥ w = x + y >= 0. The stiffness is 4 above and 1 below
// zero, so one swing takes pi/2 + pi, and the exact solution is known piecewise, with kinks at the zeros of x.

#include "catalogue/recipes.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

using std::numbers::pi;

/// Swing k starts at t = 3 pi k/2 with velocity v = nu + 2k/15; valid for nu >= 0.
void exact_state(double nu, double t, Eigen::Ref<Vector> x) {
  const double period = 1.5 * pi, k = std::floor(t / period), s = t - k * period, v = nu + 2 * k / 15;
  if (s <= pi / 2) {
    x[0] = (v + 1. / 3) / 2 * std::sin(2 * s) - std::sin(4 * s) / 12;
    x[1] = (v + 1. / 3) * std::cos(2 * s) - std::cos(4 * s) / 3;
  } else {
    x[0] = (v + 0.4) * std::cos(s) - std::sin(4 * s) / 15;
    x[1] = -(v + 0.4) * std::sin(s) - 4 * std::cos(4 * s) / 15;
  }
}

Scene build_bridge(const ParameterValues& values) {
  const double nu = values.at("nu");
  DenseDynamics bridge{Matrix(2, 2), Matrix(2, 1), Matrix(1, 2)};
  bridge.A << 0, 1, -4, 0;
  bridge.B << 0, -3;
  bridge.N << 1, 0;

  Scene scene;
  scene.dynamics = std::move(bridge);
  scene.M = Matrix(Matrix::Identity(1, 1));
  scene.lcp_class = LcpClass::P;
  scene.f = [](double t, Eigen::Ref<Vector> f) { f << 0, std::sin(4 * t); };
  scene.x0 = Eigen::Vector2d(0, nu);
  scene.T = positive_parameter(values, "T");
  scene.default_steps = 600;
  if (nu >= 0)  // with a downward start the pieces have another order
    scene.exact = [nu](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
      exact_state(nu, t, x);
      y[0] = std::max(-x[0], 0.);
    };
  return scene;
}

}  // namespace

SceneRecipe bridge_recipe() {
  return {"bridge",
          "suspension bridge with slack cables, an oscillator; the exact solution is known",
          {{"nu", 1, "initial velocity; the exact solution is known for nu >= 0"}, {"T", 3 * pi, "final time"}},
          build_bridge};
}

}  // namespace bromwich

// Three states and four constraints whose M is a Z-matrix but not a P-matrix; the matrices of example 4.1 of the paper
// on Laplace inversion for differential linear complementarity problems. Its printed sources admit no solution, so x, y
// and w are prescribed here and f, g follow from them:
//
//     f = x' - A x - B y,   g = w - N x - M y,   y the least element of LCP(M, N x + g) at every t.

#include "catalogue/recipes.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

using Vector3 = Eigen::Vector3d;
using Vector4 = Eigen::Vector4d;

struct Matrices {
  Eigen::Matrix3d A;
  Eigen::Matrix<double, 3, 4> B;
  Eigen::Matrix<double, 4, 3> N;
  Eigen::Matrix4d M;
};

Matrices matrices() {
  Matrices m;
  // clang-format off
  m.A << -2, 1, 0,
          1, -2, 1.5,
          0, -1, -2;
  m.B << -1, -4, -2, 0,
         -3, -2, -2, 0,
         -3, -3, 0, 3;
  m.N << 0, 0, -1,
         -2, -2, 1.5,
         -0.5, -1, -0.5,
         1, 2.5, 1.5;
  m.M << 2. / 3, -1, -1. / 3, -5. / 3,
         -2. / 3, 1. / 3, -2. / 3, -4. / 3,
         -2. / 3, -1. / 30, 0, -5. / 3,
         -1, 0, -5. / 3, 1. / 3;
  // clang-format on
  return m;
}

Vector3 state(double t) { return {std::exp(-t), std::cos(2 * t), 1 + t}; }
Vector3 derivative(double t) { return {-std::exp(-t), -2 * std::sin(2 * t), 1}; }
double swing(double t) { return std::sin(3 * std::numbers::pi * t); }

Vector4 multiplier(double t) {
  const double S = swing(t);
  return {0, std::max(S, 0.) / 2, 0, std::max(-S - 0.3, 0.) / 4};
}

Vector4 slack(double t) {
  const double S = swing(t);
  return {0.15 + t * std::exp(-t), std::max(-S, 0.), 0.15 + t * std::exp(-t / 3), std::max(S + 0.3, 0.)};
}

Scene build_dlcp_small(const ParameterValues& values) {
  const Matrices m = matrices();
  Scene scene;
  scene.dynamics = DenseDynamics{m.A, m.B, m.N};
  scene.M = Matrix(m.M);
  scene.lcp_class = LcpClass::Z;
  scene.f = [m](double t, Eigen::Ref<Vector> f) { f = derivative(t) - m.A * state(t) - m.B * multiplier(t); };
  scene.g = [m](double t, Eigen::Ref<Vector> g) { g = slack(t) - m.N * state(t) - m.M * multiplier(t); };
  scene.x0 = state(0);
  scene.T = positive_parameter(values, "T");
  scene.default_steps = 400;
  scene.exact = [](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
    x = state(t);
    y = multiplier(t);
  };
  return scene;
}

}  // namespace

SceneRecipe dlcp_small_recipe() {
  return {"dlcp-small",
          "three states, four constraints, M a Z-matrix; the exact solution is known",
          {{"T", 1, "final time"}},
          build_dlcp_small};
}

}  // namespace bromwich

// A bounded linear-quadratic control problem by Pontryagin's principle: the double integrator x1' = x2, x2' = v with
// |v| <= bound from (0, 0) to (1, 0) at T = 1, with the least cost 1/2 ∫ v^2. With the costates p1, p2 the optimal
// control is v = clip(-p2, ±bound) = -p2 - y_0 + y_1, and the multipliers of the bounds solve
//
//     p1' = 0,  p2' = -p1,   0 <= y_0 ⊥ p2 + y_0 - y_1 + bound >= 0,   0 <= y_1 ⊥ -p2 - y_0 + y_1 + bound >= 0.
//
// M = [[1, -1], [-1, 1]] is singular: if both bounds could be active only y_0 - y_1 would be determined, but bound > 0
// excludes that. Two of the four states are given at each end.

#include "catalogue/recipes.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {
namespace {

/// v(t) = clip(k (1 - 2t), ±bound): v is odd about 1/2, so x2(1) = 0, and x1(1) = ∫ (1 - t) v dt = 1 gives k. With
/// s = bound / k the half-width of the middle piece in 1 - 2t, x1(1) = bound (3 - s^2) / 12 for s <= 1, else k / 6.
struct OptimalControl {
  double bound, k;

  explicit OptimalControl(double limit) : bound(limit), k(6) {
    if (bound < k) k = bound / std::sqrt(3 - 12 / bound);
  }
  double saturated() const { return k > bound ? (1 - bound / k) / 2 : 0; }  ///< length of the first and last piece

  double control(double t) const { return std::clamp(k * (1 - 2 * t), -bound, bound); }
  double velocity(double t) const {  // even about 1/2
    const double s = std::min(t, 1 - t), a = saturated();
    return s <= a ? bound * s : bound * a + k * (s - a) * (1 - s - a);
  }
  double position(double t) const {  // x1(t) + x1(1 - t) = 1
    const double s = std::min(t, 1 - t), a = saturated(), r = std::max(s - a, 0.);
    double x = s <= a ? bound * s * s / 2 : bound * a * a / 2 + bound * a * r;
    x += k * (r * r * (1 - 2 * a) / 2 - r * r * r / 3);
    return t <= 0.5 ? x : 1 - x;
  }
};

Scene build_lq_control(const ParameterValues& values) {
  const double bound = values.at("bound");
  if (!(bound > 4)) throw Error("bound", "found " + number_text(bound), "give more than 4: less does not reach (1, 0)");
  Matrix A = Matrix::Zero(4, 4), B = Matrix::Zero(4, 2), N = Matrix::Zero(2, 4);
  A(0, 1) = 1;
  A(1, 3) = A(3, 2) = -1;
  B.row(1) << -1, 1;
  N.col(3) << 1, -1;
  Matrix E0 = Matrix::Zero(4, 4), ET = Matrix::Zero(4, 4);
  E0(0, 0) = E0(1, 1) = ET(2, 0) = ET(3, 1) = 1;

  Scene scene;
  scene.dynamics = DenseDynamics{A, B, N};
  scene.M = Matrix{{1, -1}, {-1, 1}};
  scene.lcp_class = LcpClass::PSD;
  scene.g = [bound](double, Eigen::Ref<Vector> g) { g.setConstant(bound); };
  scene.boundary = BoundaryCondition{E0, ET, Vector{{0, 0, 1, 0}}};
  scene.T = 1;
  scene.default_steps = 400;
  scene.exact = [optimal = OptimalControl(bound)](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
    const double p = optimal.k * (1 - 2 * t);
    x << optimal.position(t), optimal.velocity(t), -2 * optimal.k, -p;
    y << std::max(p - optimal.bound, 0.), std::max(-p - optimal.bound, 0.);
  };
  return scene;
}

}  // namespace

SceneRecipe lq_control_recipe() {
  return {"lq-control",
          "optimal control with bounds, half of the states given at either end; the exact solution is known",
          {{"bound", 5, "of the control; above 4, and from 6 on it is never reached"}},
          build_lq_control};
}

}  // namespace bromwich

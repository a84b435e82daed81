// A rectifier in its periodic steady state: a capacitor C with a load R, charged through a diode with resistance r by a
// sinusoidal voltage,
//
//     C v' = -v/R + y,   0 <= y ⊥ w = v + r y - a sin(omega t) >= 0,   v(0) = v(T),
//
// T one period. Marching from v = 0 needs several time constants R C, of which a period is a fifth.

#include "catalogue/recipes.hpp"

#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

Scene build_periodic_rectifier(const ParameterValues& values) {
  const double R = positive_parameter(values, "R"), C = positive_parameter(values, "C");
  const double r = positive_parameter(values, "r"), a = positive_parameter(values, "a");
  const double frequency = positive_parameter(values, "frequency");
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1 / (R * C)}}, Matrix{{1 / C}}, Matrix{{1}}};
  scene.M = Matrix{{r}};
  scene.lcp_class = LcpClass::P;
  scene.g = [a, omega = 2 * std::numbers::pi * frequency](double t, Eigen::Ref<Vector> g) {
    g[0] = -a * std::sin(omega * t);
  };
  scene.boundary = BoundaryCondition{Matrix{{1}}, Matrix{{-1}}, Vector{{0}}};
  scene.T = 1 / frequency;
  scene.default_steps = 400;
  return scene;
}

}  // namespace

SceneRecipe periodic_rectifier_recipe() {
  return {"periodic-rectifier",
          "capacitor behind a diode over one period, v(0) = v(T)",
          {{"R", 100, "load, ohm"},
           {"C", 1e-3, "capacity, farad"},
           {"r", 1, "series resistance, ohm"},
           {"a", 10, "amplitude, volt"},
           {"frequency", 50, "hertz"}},
          build_periodic_rectifier};
}

}  // namespace bromwich

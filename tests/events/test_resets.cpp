// Modes with memory: states that jump where a guard falls below 0, against closed forms.

#include "core/base/error.hpp"
#include "core/solve/shooting_control.hpp"
#include "core/solve/solve.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace resets_test {

Result solved(const Scene& scene, double tolerance = 1e-8) {
  const auto backend = make_cpu_backend(1);
  Options options;
  if (scene.boundary)
    options.steps = 64;
  else
    options.tolerance_x = tolerance;
  options.states = StateSelection::all;
  return solve(scene, *backend, options);
}

double at_end(const Result& r, Index state) { return r.x(r.x.rows() - 1, state); }

// x' = size - x from 0; where it comes to size/2 it begins again: a period of ln 2. The guard is the only row.
TEST(Resets, AStateThatBeginsAgain) {
  for (const double size : {1.0, 3e7}) {
    Scene scene;
    scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{0}}, Matrix{{-1}}};
    scene.M = Matrix{{1}};
    scene.f = [size](double, Eigen::Ref<Vector> f) { f[0] = size; };
    scene.g = [size](double, Eigen::Ref<Vector> g) { g[0] = size / 2; };
    scene.x0 = Vector{{0}};
    scene.T = 3;
    scene.resets = {{0, 0, 0}};
    const Result r = solved(scene);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_EQ(r.method, Method::events);
    EXPECT_NEAR(at_end(r, 0), -size * std::expm1(-(3 - 4 * std::log(2))), 1e-9 * size);
  }
}

// x' = 2 h - x, h = 1 from x < 0.9 on and 0 from x > 1.1 on: both ways take ln(1.1 / 0.9).
Scene thermostat() {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1, 2}, {0, 0}}, Matrix{{0, 0}, {0, 0}}, Matrix{{1, 0}, {-1, 0}}};
  scene.M = Matrix{{1, 0}, {0, 1}};
  scene.g = [](double, Eigen::Ref<Vector> g) { g << -0.9, 1.1; };
  scene.x0 = Vector{{1.1, 0}};
  scene.resets = {{0, 1, 1}, {1, 1, 0}};
  return scene;
}

TEST(Resets, AThermostatKeepsItsMode) {
  Scene scene = thermostat();
  const double way = std::log(1.1 / 0.9);
  scene.T = 5.5 * way;  // in the middle of the third time that it heats
  const Result r = solved(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(at_end(r, 1), 1);
  EXPECT_NEAR(at_end(r, 0), 2 - 1.1 * std::exp(-way / 2), 1e-9);
  EXPECT_FALSE(r.continuous);
}

TEST(Resets, BeginsInTheModeThatItsGuardsAskFor) {
  Scene scene = thermostat();
  scene.x0 = Vector{{0.5, 0}};
  scene.T = 0.2;
  const Result r = solved(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NEAR(at_end(r, 0), 2 - 1.5 * std::exp(-0.2), 1e-9);
}

// A coil between voltages a (on) and -b (off), switched on by a clock of period 1 and off at i = 1: the periodic state
// has i(0) = 1 - a b / (a + b), and a change of i(0) comes back times -b/a.
TEST(Resets, PeriodicStatesByShooting) {
  constexpr double a = 1.4, b = 1;
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, a + b}, {0, 0}}, Matrix::Zero(2, 2), Matrix{{0, 0}, {-1, 0}}};
  scene.M = Matrix{{1, 0}, {0, 1}};
  scene.f = [](double, Eigen::Ref<Vector> f) { f << -b, 0; };
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << (t < 0.01 ? -1 : 1), 1; };
  scene.breakpoints = {0.01};
  scene.breakpoints_are_all = true;
  scene.boundary = BoundaryCondition{Matrix::Identity(2, 2), -Matrix::Identity(2, 2), Vector::Zero(2)};
  scene.T = 1;
  scene.resets = {{0, 1, 1}, {1, 1, 0}};
  const Result r = solved(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.method, Method::shooting);
  EXPECT_NEAR(r.start[0], 1 - a * b / (a + b), 1e-9);
  ASSERT_EQ(r.multipliers.size(), 2u);
  EXPECT_NEAR(r.multipliers[0].real(), -b / a, 1e-9);
  EXPECT_NEAR(std::abs(r.multipliers[1]), 0, 1e-12);
}

TEST(Resets, OtherMethodsRefuse) {
  Scene scene = thermostat();
  const auto backend = make_cpu_backend(1);
  for (const Method method : {Method::march, Method::euler, Method::galerkin, Method::goal}) {
    const Result r = solve(scene, *backend, options_for(method, 10));
    EXPECT_EQ(r.status, Status::unsupported) << to_string(method);
    EXPECT_NE(r.reason.find("modes with memory"), std::string::npos) << r.reason;
  }
}

TEST(Resets, ModesThatChangeWithoutEndAreNamed) {
  Scene scene = thermostat();
  scene.g = [](double, Eigen::Ref<Vector> g) { g << -1.0, 1.0; };  // no hysteresis: x stays at 1
  scene.x0 = Vector{{1.5, 0}};
  scene.T = 3;
  const Result r = solved(scene);
  EXPECT_EQ(r.status, Status::tolerance_not_met);
}

TEST(Resets, MistakesAreNamed) {
  const auto message = [](const std::function<void(Scene&)>& change) {
    Scene scene = thermostat();
    change(scene);
    try {
      scene.validate();
      return std::string();
    } catch (const Error& error) {
      return std::string(error.what());
    }
  };
  EXPECT_EQ(message([](Scene&) {}), "");
  EXPECT_NE(message([](Scene& s) { s.resets[0].guard = 2; }).find("name row 2"), std::string::npos);
  EXPECT_NE(message([](Scene& s) { s.resets[0].state = -1; }).find("state -1"), std::string::npos);
  EXPECT_NE(message([](Scene& s) { s.resets[0].value = NAN; }).find("not finite"), std::string::npos);
  EXPECT_NE(message([](Scene& s) { s.M = Matrix{{1, 1}, {0, 1}}; }).find("the guard 1, which acts"), std::string::npos);
  EXPECT_NE(message([](Scene& s) { s.M = Matrix{{0, 0}, {0, 1}}; }).find("the guard 0"), std::string::npos);
}

}  // namespace resets_test
}  // namespace bromwich

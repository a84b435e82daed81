// Fixed steps that are too few for f or g: a warning, and none where sources are resolved, jump, or are fast for a
// moment.

#include "core/scene/coarse_sources.hpp"

#include "catalogue/catalogue.hpp"
#include "core/scene/separable.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

constexpr Index J = 400;

double missed(const std::function<double(double)>& source, std::vector<double> breakpoints = {}) {
  Scene scene = make_scene("dlcp-small");
  scene.f = nullptr;
  scene.g = [n = scene.constraints(), source](double t, Eigen::Ref<Vector> g) {
    g.setZero();
    g[n - 1] = source(t);
  };
  scene.breakpoints = std::move(breakpoints);
  return find_coarse_sources(scene, time_grid(1, J)).missed;
}

std::function<double(double)> sine(double steps_a_period, double phase = 0) {
  return [=](double t) { return std::sin(2 * std::numbers::pi * double(J) / steps_a_period * t + phase); };
}

// In the middle of a step around an extreme the line is off by 1 - cos(pi/k); in one between two extremes, for k = 4,
// by (1 - cos(pi/4)) cos(pi/4) = 0.21, and looks are in the middle two fifths of steps, where it is 0.84 of that.
TEST(CoarseSources, AreSinesWithFewStepsAPeriod) {
  for (const double k : {2.2, 3.0, 3.5, 4.0, 4.5})
    for (const double phase : {0.0, 0.4, 1.3}) {
      const double most = 1 - std::cos(std::numbers::pi / k);
      EXPECT_GT(missed(sine(k, phase)), 0.15) << k;
      EXPECT_LE(missed(sine(k, phase)), 1.02 * most) << k;  // relative to the largest value that was seen
    }
  for (const double k : {7.0, 10.0, 40.0, 400.0}) EXPECT_EQ(missed(sine(k)), 0) << k;
  EXPECT_EQ(missed([](double) { return 0.0; }), 0);
}

TEST(CoarseSources, AreNotThoseThatJumpOrAreFastForAMoment) {
  const auto square = [](double t) { return std::sin(2 * std::numbers::pi * 57 * t) > 0 ? 1.0 : -1.0; };
  EXPECT_EQ(missed(square), 0);
  EXPECT_EQ(missed([](double t) { return t < 0.31234 ? 0.0 : 1.0; }), 0);
  EXPECT_EQ(missed([](double t) { return std::abs(std::sin(20 * t)); }), 0);
  EXPECT_EQ(missed([](double t) { return std::exp(-1e4 * t); }), 0);
  EXPECT_EQ(missed([](double t) { return std::tanh((t - 0.4) / 1e-4); }), 0);
  // Fast between named breakpoints, in every step: method march takes it in parts.
  std::vector<double> edges;
  for (Index j = 0; j < 3 * J; ++j) edges.push_back((double(j) + 0.5) / double(3 * J));
  EXPECT_EQ(missed(sine(3), edges), 0);
}

// x' = -400 x + 400 cos(wt) + y, w = x + y + 2 with y = 0: implicit Euler takes means of f, and x is off by its size.
TEST(CoarseSources, AreWarnedOf) {
  for (const double k : {3.0, 3.6, 4.0, 40.0}) {
    Scene scene;
    const double a = 400, w = 2 * std::numbers::pi * double(J) / k;
    scene.dynamics = DenseDynamics{Matrix{{-a}}, Matrix{{1}}, Matrix{{1}}};
    scene.M = Matrix{{1}};
    scene.f = [a, w](double t, Eigen::Ref<Vector> f) { f[0] = a * std::cos(w * t); };
    scene.g = [](double, Eigen::Ref<Vector> g) { g[0] = 2; };
    scene.breakpoints_are_all = true;
    scene.x0 = Vector{{a * a / (a * a + w * w)}};  // x = a (a cos wt + w sin wt) / (a^2 + w^2)
    scene.T = 1;
    for (const Method method : {Method::march, Method::contour, Method::euler, Method::galerkin}) {
      Options options = options_for(method);
      options.steps = J;
      options.states = StateSelection::all;
      const Result r = run(scene, options);
      const std::string& said = r.status == Status::solved ? r.warning : r.reason;
      double error = 0;
      for (Index j = 0; j <= J; ++j)
        error = std::max(
            error, std::abs(r.x(j, 0) - a * (a * std::cos(w * r.t[j]) + w * std::sin(w * r.t[j])) / (a * a + w * w)));
      const double share = error * std::hypot(a, w) / a;
      if (!(share > 0.01 && share < 0.04)) {
        EXPECT_EQ(said.find("x by about") != std::string::npos, share > 0.02) << k << to_string(method) << said;
      }
      if (method == Method::euler && k < 10) {
        EXPECT_GT(share, 0.3) << "no reason to warn";
      }
      options.tolerance = 1e-2;  // which chooses the steps
      if (method == Method::march) {
        EXPECT_EQ(run(scene, options).warning, "") << k;
      }
    }
  }
}

}  // namespace
}  // namespace bromwich

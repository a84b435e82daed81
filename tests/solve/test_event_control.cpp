// Method events by name: fixed steps, scenes that it refuses, residual.

#include "catalogue/catalogue.hpp"
#include "core/scene/relay.hpp"
#include "tests/support/reference_backend.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

namespace bromwich {
namespace {

TEST(EventControl, SolvesOnTheGridOfTheOptions) {
  const Scene scene = make_scene("bridge");
  const Result r = run(scene, options_for(Method::events, 50));
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.steps, 50);
  EXPECT_EQ(r.method, Method::events);
  Vector x(scene.states()), y(scene.constraints());
  for (Index j = 1; j <= r.steps; ++j) {
    scene.exact(r.t[j], x, y);
    EXPECT_LE((r.y.row(j).transpose() - y).cwiseAbs().maxCoeff(), 1e-7);
  }
}

TEST(EventControl, SaysWhatItDoesNotTake) {
  const Result large = run(make_scene("signorini", {{"Q", 127}}), options_for(Method::events, 20));
  EXPECT_EQ(large.status, Status::unsupported);
  EXPECT_NE(large.reason.find("method march"), std::string::npos) << large.reason;
  const Result boundary = run(make_scene("lq-control"), options_for(Method::events, 20));
  EXPECT_EQ(boundary.status, Status::unsupported);
  EXPECT_NE(boundary.reason, "");
  for (const Result* r : {&large, &boundary}) {  // rows without numbers: what reads them needs no case of its own
    ASSERT_EQ(r->t.size(), 21);
    EXPECT_EQ(r->y.rows(), 21);
    EXPECT_EQ(r->x.rows(), 21);
    EXPECT_TRUE(r->y.array().isNaN().all());
  }
}

// Two relays of one direction, x' = lambda_0 + lambda_1 + sin 3t, both in -Sgn(x): on x = 0 only their sum is known.
TEST(EventControl, NamesAYThatIsOneOfSeveral) {
  const auto f = [](double t, Eigen::Ref<Vector> v) { v.setConstant(std::sin(3 * t)); };
  Scene scene = relay_scene(Matrix{{0}}, Matrix{{1, 1}}, Matrix{{1}, {1}}, f, Vector::Ones(1));
  scene.T = 4;
  Options options = options_for(Method::events);
  options.tolerance = 1e-6;
  options.states = StateSelection::all;
  const Result r = run(scene, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NE(r.warning.find("y is not unique"), std::string::npos) << r.warning;
  EXPECT_NEAR(r.x(r.steps, 0), 0, 1e-6);
  EXPECT_NEAR(2 - 4 * r.y(r.steps, 0), -std::sin(12), 1e-6) << "half of the sum of both lambda";
  EXPECT_NEAR(r.y(r.steps, 1), r.y(r.steps, 0), 1e-6) << "of least norm";
}

// x' = v, v' = -x - 1/2 + y with a stop at x = 0, in units of 1, and in others by powers of ten.
Scene oscillator(double x, double y, double t) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1 / t}, {-1 / t, 0}}, Matrix{{0}, {x / (y * t)}}, Matrix{{1 / x, 0}}};
  scene.M = Matrix{{0}};
  scene.f = [x, t](double, Eigen::Ref<Vector> v) { v << 0, -0.5 * x / t; };
  scene.x0 = Vector{{x, 0}};
  scene.T = 3 * t;
  return scene;
}

Options to_tolerance() {
  Options options;
  options.tolerance = 1e-6;
  options.states = StateSelection::all;
  return options;
}

// The estimate of given steps too is relative: two integrations agree to rounding in all units.
TEST(EventControl, UnitsChangeNothing) {
  for (const Index steps : {0, 20}) {
    Options options = to_tolerance();
    if (steps > 0) options = options_for(Method::events, steps), options.states = StateSelection::all;
    const Result one = run(oscillator(1, 1, 1), options);
    ASSERT_EQ(one.status, Status::solved) << one.reason;
    EXPECT_EQ(one.method, Method::events);
    for (const auto& [x, y, t] :
         {std::array{1e9, 1e-6, 1e3}, std::array{1e-12, 1e12, 1e-9}, std::array{1e15, 1e15, 1.0}}) {
      const Result other = run(oscillator(x, y, t), options);
      ASSERT_EQ(other.status, Status::solved) << other.reason;
      ASSERT_EQ(other.steps, one.steps);
      EXPECT_LE((other.x / x - one.x).cwiseAbs().maxCoeff(), 1e-10);
      EXPECT_LE((other.y_integral / (y * t) - one.y_integral).cwiseAbs().maxCoeff(), 1e-10);
      EXPECT_LE(other.error_estimate.value_or(1), 1e-9);
    }
  }
}

TEST(EventControl, IntegratesYWithItsImpulses) {
  const Result r = run(oscillator(1, 1, 1), to_tolerance());
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  ASSERT_TRUE(r.errors);
  EXPECT_TRUE(r.errors->of_integral) << "y has an impulse";
  const double hit = std::acos(1.0 / 3);
  EXPECT_NEAR(r.y_integral(r.steps, 0), std::sqrt(2.0) + 0.5 * (3 - hit), 1e-6);
}

TEST(EventControl, AgreesOnBothBackends) {
  const auto reference = make_reference_backend();
  const Scene scene = oscillator(1, 1, 1);
  const Result a = run(scene, to_tolerance()), b = solve(scene, *reference, to_tolerance());
  ASSERT_EQ(a.status, b.status) << b.reason;
  EXPECT_EQ((a.y - b.y).cwiseAbs().maxCoeff(), 0);
  EXPECT_EQ((a.x - b.x).cwiseAbs().maxCoeff(), 0);
}

// w = x + y + g, g a pulse of -2 on [0.3, 0.3 + d): y = 2 - x there. x' = y - x = 2 - 2 x from 0, then decay.
Scene pulsed(double d, bool told) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{1}};
  scene.g = [d](double t, Eigen::Ref<Vector> v) { v[0] = t >= 0.3 && t < 0.3 + d ? -2 : 0; };
  scene.x0 = Vector{{0}};
  scene.T = 1;
  scene.default_steps = 100;
  if (told) scene.breakpoints = {0.3, 0.3 + d};
  return scene;
}
double pulsed_end(double d) { return (1 - std::exp(-2 * d)) * std::exp(-(0.7 - d)); }

TEST(EventControl, FindsBreakpoints) {
  for (const bool told : {false, true}) {
    const Result r = run(pulsed(1e-3, told), to_tolerance());
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_NEAR(r.x(r.steps, 0), pulsed_end(1e-3), 1e-6 * pulsed_end(1e-3) + 1e-9) << told;
  }
}

// Methods that take g at the ends of steps alone: an estimate that holds, or no solution.
TEST(EventControl, MeasuresNamedMethods) {
  const double d = 7.3e-4, exact = pulsed_end(d), size = 1 - std::exp(-2 * d);  // x is largest at the end of the pulse
  for (const Method method : {Method::march, Method::contour, Method::multigrid, Method::euler, Method::galerkin}) {
    Options options = to_tolerance();
    options.method = method;
    options.tolerance = 1e-2;
    options.max_steps = 1 << 15;
    const Result r = run(pulsed(d, true), options);
    if (r.status != Status::solved) {
      EXPECT_EQ(r.status, Status::tolerance_not_met) << to_string(method);
      continue;
    }
    const double error = std::abs(r.x(r.steps, 0) - exact) / size;
    EXPECT_LE(error, 1e-2) << to_string(method);
    EXPECT_LE(error, *r.error_estimate + 1e-9) << to_string(method);
  }
}

}  // namespace
}  // namespace bromwich

// Method galerkin with M singular on the active set: jumps of the state, impacts, sliding, for initial and boundary
// values. References are solved by hand, or by implicit Euler with negligible steps.

#include "core/galerkin/recovery.hpp"
#include "core/galerkin/rules.hpp"
#include "core/galerkin/sources.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

using reference::pi;

Result all_states(const Scene& scene, Index steps) {
  Options options = options_for(Method::galerkin, steps);
  options.states = StateSelection::all;
  return run(scene, options);
}

/// A square wave of amplitude 1, high on the first half of each period; continuous from the right.
double square(double t, double period) { return std::fmod(t, period) < period / 2 ? 1 : -1; }

/// Two ideal diodes and two capacitors driven by a square wave of 10 V. Charge flows at once at every edge.
Scene doubler(double leak) {
  Scene scene;
  scene.name = "doubler";
  scene.dynamics = DenseDynamics{Matrix{{0, 0}, {0, -leak}}, Matrix{{1, -1}, {0, 1}}, Matrix{{1, 0}, {-1, 1}}};
  scene.M = Matrix::Zero(2, 2);
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << 10 * square(t, 0.2), -10 * square(t, 0.2); };
  scene.x0 = Vector::Zero(2);
  scene.T = 2;
  return scene;
}

/// The same by charges: v_1 >= -s and v_2 >= v_1 + s at all times; charge moves only as far as needed.
Vector doubler_at_end(double leak) {
  Vector v = Vector::Zero(2);
  for (int half = 0; half < 20; ++half) {
    const double s = half % 2 == 0 ? 10 : -10;
    if (v[0] < -s) v[0] = -s;
    if (v[1] < v[0] + s) {  // the charge through the second diode raises v_2 and lowers v_1 by the same amount
      const double charge = (v[0] + s - v[1]) / 2;
      v += Vector{{-charge, charge}};
    }
    if (half % 2 == 0) {
      // The second diode conducts while v_2 leaks: v_1 + s = v_2, (v_1 + v_2)' = -leak v_2, v_2' = -leak v_2 / 2.
      const double factor = std::exp(-leak * 0.1 / 2), before = v[1];
      v[1] *= factor;
      v[0] += v[1] - before;
    } else {
      v[1] *= std::exp(-leak * 0.1);
    }
  }
  return v;
}

TEST(GalerkinRules, DoublerWithASquareWave) {
  const double leak = 0.3;
  const Vector exact = doubler_at_end(leak);
  double before = 0;
  for (const Index N : {40, 160, 640}) {
    const Result r = all_states(doubler(leak), N);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_NE(r.kernel.find("the state may jump"), std::string::npos) << r.kernel;
    const double error = (r.x.row(N).transpose() - exact).cwiseAbs().maxCoeff();
    // An edge costs one Euler step, 1/2 (leak h)^2 10 V; there are 20 edges.
    EXPECT_LE(error, 20 * 10 * std::pow(leak * 2 / double(N), 2)) << N;
    if (before > 0) {
      EXPECT_LE(error, before / 8) << N;
    }
    before = error;
  }
}

TEST(GalerkinRules, IncompatibleInitialStates) {
  Scene scene;  // x' = -x + y, x >= 0: jumps from -1 to 0 and stays there
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{0}};
  scene.x0 = Vector{{-1}};
  const Result r = all_states(scene, 50);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.x(0, 0), -1);
  EXPECT_LE(r.x.bottomRows(50).cwiseAbs().maxCoeff(), 1e-14);
  EXPECT_LE(r.y.bottomRows(49).cwiseAbs().maxCoeff(), 1e-12);
  // The impulse raises x by 1 plus its loss over the step: h y = 1 for implicit Euler.
  EXPECT_NEAR(r.y(1, 0) / 50, 1, 1e-12);
}

/// A ball on a rigid floor that falls, lies and is thrown up by a force: x'' = -g + push(t) + y.
Scene pushed_ball(double push_at) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {0, 0}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  scene.M = Matrix{{0}};
  scene.f = [=](double t, Eigen::Ref<Vector> f) { f << 0, t < push_at ? -9.81 : 5.0; };
  scene.x0 = Vector{{1, 0}};
  scene.T = 2;
  return scene;
}

TEST(GalerkinRules, BallOnARigidFloor) {
  // The floor absorbs the velocity; from 1.5 on it rises with 5 m/s^2: x = 5/2 0.5^2, v = 2.5.
  for (const Index N : {200, 800, 3200}) {
    const Result r = all_states(pushed_ball(1.5), N);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    const double h = 2 / double(N);
    EXPECT_NEAR(r.x(N, 0), 0.625, 5 * 0.5 * h) << N;  // the step to the push may be an Euler step: v off by 5 h at most
    EXPECT_NEAR(r.x(N, 1), 2.5, 5 * h) << N;
    EXPECT_NEAR(r.y(N / 2, 0), 9.81, 1e-9);  // at rest
  }
}

TEST(GalerkinRules, SlidingRelay) {
  // x' = sin t - 2 Sgn x reaches 0 before 0.25; from then on 2 (1 - 2 s) = -sin t, with y = (s, p).
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{-4, 0}}, Matrix{{-1}, {0}}};
  scene.M = Matrix{{0, 1}, {-1, 0}};
  scene.f = [](double t, Eigen::Ref<Vector> f) { f << 2 + std::sin(t); };
  scene.g = [](double, Eigen::Ref<Vector> g) { g << 0, 1; };
  scene.x0 = Vector{{0.25}};
  scene.T = 3;
  const Result r = all_states(scene, 300);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  for (Index k = 60; k <= 300; ++k) {
    EXPECT_NEAR(r.x(k, 0), 0, 1e-12) << k;
    EXPECT_NEAR(r.y(k, 0), (2 + std::sin(r.t[k])) / 4, 1e-4) << k;  // h^2
  }
}

TEST(GalerkinRules, PeriodicStateOfAnIdealClamp) {
  // C v' = -v/R + y, v >= 2 square(t): jumps to 2 at the rising edge, stays there, and decays from the falling edge on.
  Scene scene;
  const double a = 1.5;
  scene.dynamics = DenseDynamics{Matrix{{-a}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{0}};
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << -2 * square(t, 1); };
  scene.boundary = BoundaryCondition{Matrix{{1}}, Matrix{{-1}}, Vector{{0}}};
  for (const Index N : {40, 640}) {
    const Result r = all_states(scene, N);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_NEAR(r.x(N / 2, 0), 2, 1e-12) << N;
    // Free from 1/2 to 1, by the exact exponential.
    EXPECT_NEAR(r.x(N, 0), 2 * std::exp(-a / 2), 1e-12) << N;
    EXPECT_NEAR(r.x(0, 0), r.x(N, 0), 1e-12) << N;
  }
}

TEST(GalerkinRules, RegularScenesAreLeftAlone) {
  Scene scene = pushed_ball(1.5);
  scene.M = Matrix{{1e-3}};
  const Result r = all_states(scene, 200);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.kernel.find("Radau"), std::string::npos) << r.kernel;
  EXPECT_EQ(r.kernel.find("M is singular"), std::string::npos) << r.kernel;
}

TEST(GalerkinRules, WhichRuleAnActiveSetNeeds) {
  Scene scene;  // y_0 acts on w_0', y_1 on w_1'', y_2 on w_2 through M, y_3 on nothing
  scene.dynamics =
      DenseDynamics{Matrix{{0, 1}, {0, 0}}, Matrix{{1, 0, 0, 0}, {0, 1, 1, 0}}, Matrix{{1, 0}, {1, 0}, {0, 1}, {0, 0}}};
  scene.M = Matrix(Vector{{0, 0, 1, 0}}.asDiagonal());
  scene.x0 = Vector::Zero(2);
  RuleChoice choice(scene);
  const auto rule = [&](std::initializer_list<Index> active) {
    Vector z = Vector::Zero(8);
    for (const Index i : active) z[i] = 1;
    return choice.needed(z);
  };
  EXPECT_EQ(rule({}), IntervalRule::galerkin);
  EXPECT_EQ(rule({2}), IntervalRule::galerkin);
  EXPECT_EQ(rule({0}), IntervalRule::radau);
  EXPECT_EQ(rule({4}), IntervalRule::radau);  // at the right end of the interval
  EXPECT_EQ(rule({0, 2}), IntervalRule::radau);
  EXPECT_EQ(rule({1}), IntervalRule::euler);
  EXPECT_EQ(rule({3}), IntervalRule::euler);
}

// States between nodes follow the rules too: they match the result on the nodes, the ball falls freely before the
// impact and rests afterwards.
TEST(GalerkinRules, StatesAtAnyTime) {
  const Scene scene = pushed_ball(1.5);
  const Result r = all_states(scene, 200);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  ASSERT_EQ(r.interval_rules.size(), 200u);
  std::vector<double> nodes(r.t.begin(), r.t.end());
  EXPECT_LE(distance(galerkin_at(scene, r, nodes).x, r.x), 1e-12);
  const GalerkinOutput out = galerkin_at(scene, r, {0.2034, 1.2047, 1.9023});
  EXPECT_NEAR(out.x(0, 0), 1 - 9.81 / 2 * 0.2034 * 0.2034, 1e-12);
  EXPECT_NEAR(out.x(1, 0), 0, 1e-12);
  EXPECT_NEAR(out.y(1, 0), 9.81, 1e-9);
  EXPECT_NEAR(out.x(2, 1), 5 * 0.4023, 5 * 0.01);  // as far as the step to the push is known
}

/// x' = -3 x + f, w = 2 x + g; f and g jump at 0.3 of an interval, to f = 1 and g = -1.
struct SteppedSources {
  Scene scene;
  DenseDynamics dynamics{Matrix{{-3}}, Matrix{{1}}, Matrix{{2}}};

  SteppedSources() {
    scene.dynamics = dynamics;
    scene.M = Matrix{{1}};
    scene.x0 = Vector{{0}};
    scene.f = [](double t, Eigen::Ref<Vector> f) { f << (t < 0.3 ? 0 : 1); };
    scene.g = [](double t, Eigen::Ref<Vector> g) { g << (t < 0.3 ? 0 : -1); };
  }
  /// F and q on [0, 1].
  std::pair<double, Vector> on_interval(std::vector<double> breakpoints) const {
    GalerkinSources sources(scene, dynamics, Matrix{{1}}, std::move(breakpoints));
    Vector F = Vector::Zero(1), q = Vector::Zero(2);
    sources.add(0, 1, F, q);
    return {F[0], q};
  }
};

TEST(GalerkinSources, JumpsInsideAnInterval) {
  const SteppedSources stepped;
  // x = (1 - e^{-3 (t - 0.3)}) / 3 from 0.3 on; moments 2 ∫ psi (2 x - 1) by Simpson's rule on 10000 panels, to 1e-14.
  const auto x = [](double t) { return (1 - std::exp(-3 * (t - 0.3))) / 3; };
  double left = 0, right = 0;
  constexpr int panels = 10000;
  for (int i = 0; i <= 2 * panels; ++i) {
    const double t = 0.3 + 0.7 * i / (2. * panels), weight = (i == 0 || i == 2 * panels ? 1 : i % 2 == 1 ? 4 : 2);
    const double w = 2 * (2 * x(t) - 1) * weight * 0.7 / (6. * panels);
    left += (1 - t) * w;
    right += t * w;
  }
  const auto [F, q] = stepped.on_interval({0.3});
  EXPECT_NEAR(F, x(1), 1e-13);
  EXPECT_NEAR(q[0], left, 1e-12);
  EXPECT_NEAR(q[1], right, 1e-12);
  // An undeclared jump is found to 2^-16 of the interval, the length of the last piece.
  const auto [found, p] = stepped.on_interval({});
  EXPECT_NEAR(found, x(1), std::exp2(-16));
  EXPECT_NEAR(p[0], left, 8 * std::exp2(-16));
  EXPECT_NEAR(p[1], right, 8 * std::exp2(-16));
}

TEST(GalerkinSources, BreakpointsOnNodesCostNothing) {
  SteppedSources smooth;
  smooth.scene.f = [](double t, Eigen::Ref<Vector> f) { f << std::cos(t); };
  smooth.scene.g = {};
  const auto [F, q] = smooth.on_interval({});
  const auto [same, p] = smooth.on_interval({0, 1});
  EXPECT_EQ(F, same);
  EXPECT_EQ(q, p);
}

}  // namespace
}  // namespace bromwich

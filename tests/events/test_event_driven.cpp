// Event-driven integration against solutions by hand and the independent event-located oracle.

#include "core/events/event_driven.hpp"
#include "tests/support/random_sources.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

// q' = v, v' = -1 + y, 0 <= y, q >= 0.
Scene ball(double height) {
  Scene scene;
  DenseDynamics d;
  d.A = Matrix::Zero(2, 2);
  d.A(0, 1) = 1;
  d.B = Vector::Unit(2, 1);
  d.N = Vector::Unit(2, 0).transpose();
  scene.dynamics = d;
  scene.M = Matrix(Matrix::Zero(1, 1));
  scene.x0 = Vector::Unit(2, 0) * height;
  scene.f = [](double, Eigen::Ref<Vector> v) {
    v.setZero();
    v[1] = -1;
  };
  scene.T = 3;
  return scene;
}

TEST(EventDriven, ABallComesToRestOnARigidFloor) {
  const Scene scene = ball(0.5);  // lands at t = 1 with v = -1
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  EXPECT_EQ(s.jumps, 1);
  EXPECT_FALSE(s.continuous);
  EXPECT_NEAR(s.x(0.5, true)[0], 0.375, 1e-10);  // EventOptions::tolerance
  EXPECT_NEAR(s.x(2, true).norm(), 0, 1e-9);
  EXPECT_NEAR(s.y(2, true)[0], 1, 1e-9);
  EXPECT_NEAR(s.integral_of_y(3, true)[0], 1 + 2, 1e-9) << "the impulse and the weight";
}

// A mass starts at rest on a stop that is not at q = 0, pressed on by v' = -2 cos t + y up to t = pi/2. The first part
// of the way is as short as rounding: there the second derivative of g = 1/4 is 0, and not rounding of g over its
// square.
TEST(EventDriven, AMassStartsOnItsStop) {
  for (const double below : {0.0, 1e-17, 1e-16}) {
    Scene scene = ball(-0.25 - below);
    scene.f = [](double t, Eigen::Ref<Vector> v) { v << 0, -2 * std::cos(t); };
    scene.g = [](double, Eigen::Ref<Vector> v) { v.setConstant(0.25); };
    const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, {});
    ASSERT_TRUE(s.complete) << s.reason;
    EXPECT_NEAR(s.y(1, true)[0], 2 * std::cos(1.0), 1e-9);
    EXPECT_NEAR(s.x(3, true)[0], -0.25 + 2 * std::cos(3.0) + 6 - std::numbers::pi, 1e-9);
    EXPECT_NEAR(s.x(3, true)[1], 2 - 2 * std::sin(3.0), 1e-9);
  }
}

// x = -1e-11 e^{-t}, w = x + 2 y + g, g = 1 up to t = 1 and 0 after it: y = 5e-12 e^{-t} from there, far below what
// counts as zero beside g.
Scene tiny_y() {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{0}}, Matrix{{1}}};
  scene.M = Matrix{{2}};
  scene.g = [](double t, Eigen::Ref<Vector> v) { v.setConstant(t < 1 ? 1 : 0); };
  scene.breakpoints = {1};
  scene.x0 = Vector::Constant(1, -1e-11);
  scene.T = 2;
  return scene;
}

// Held by a force to the end: whatever T, no step is left there that is too short for y to have a sign.
TEST(EventDriven, StepsEndWithT) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {-1.18, -0.1}}, Matrix{{0}, {-0.636}}, Matrix{{-0.636, 0}}};
  scene.M = Matrix{{0}};
  scene.f = [](double t, Eigen::Ref<Vector> f) { f << 0, 3.948 * std::sin(0.531 * (t + 3.4465)); };
  scene.g = [](double, Eigen::Ref<Vector> g) { g[0] = 0.0434850374165052; };
  scene.x0 = Vector{{0.0434850374165052 / 0.636, -1e-13}};
  for (int k = 0; k <= 160; ++k) {
    scene.T = 0.3 + 0.01 * k;
    const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, {});
    ASSERT_TRUE(s.complete) << scene.T << ": " << s.reason;
    EXPECT_NEAR(s.x(scene.T, true)[0], scene.x0[0], 1e-12) << scene.T;
  }
}

TEST(EventDriven, SignsBelowWhatCountsAsZeroAreInDoubt) {
  const EventSolution s = integrate_with_events(tiny_y(), LcpClass::P, {1}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  const double y = 5e-12 * std::exp(-1.0);
  EXPECT_GE(std::max(s.y(1.001, false)[0], s.doubt[0]), 0.9 * y) << "found, or in doubt";
  EXPECT_LE(s.doubt[0], 10 * 1e-10 / 2) << "what counts as zero beside g = 1, over M";
  Scene plain = tiny_y();
  plain.x0 *= 1e11;
  EXPECT_LE(integrate_with_events(plain, LcpClass::P, {1}, {}).doubt[0], 1e-14);
}

// x' = x + y from 1/2, w = x + y - 1: y = 1 - x and x = 1/2 + t up to t = 1/2, then x' = x. I - TA = 0.
TEST(EventDriven, AModeThatGrowsByEWithinT) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{1}};
  scene.g = [](double, Eigen::Ref<Vector> v) { v.setConstant(-1); };
  scene.x0 = Vector::Constant(1, 0.5);
  scene.T = 1;
  const EventSolution s = integrate_with_events(scene, LcpClass::P, {}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  EXPECT_NEAR(s.x(0.25, true)[0], 0.75, 1e-10);  // EventOptions::tolerance
  EXPECT_NEAR(s.x(1, true)[0], std::exp(0.5), 1e-9);
}

// x' = -x + y_0 + y_1 from 0, w_0 = w_1 = x + y_0 + y_1 - 1: s = y_0 + y_1 = 1 - x, x' = 1 - 2 x, x = (1 - e^{-2t}) /
// 2, and s is shared equally (least norm).
TEST(EventDriven, EqualConstraintsShareY) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1, 1}}, Matrix{{1}, {1}}};
  scene.M = Matrix(Matrix::Ones(2, 2));
  scene.g = [](double, Eigen::Ref<Vector> v) { v.setConstant(-1); };
  scene.x0 = Vector::Zero(1);
  scene.T = 2;
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  for (const double t : {0.1, 0.7, 2.0}) {
    const double x = (1 - std::exp(-2 * t)) / 2;
    EXPECT_NEAR(s.x(t, true)[0], x, 1e-10);  // EventOptions::tolerance
    EXPECT_NEAR(s.y(t, true)[0], (1 - x) / 2, 1e-10);
    EXPECT_NEAR(s.y(t, true)[1], (1 - x) / 2, 1e-10);
  }
}

// The same with g_1 = g_0 up to t = 1, and larger from then on: y_0 acts alone.
TEST(EventDriven, EqualConstraintsPartAtABreakpoint) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1, 1}}, Matrix{{1}, {1}}};
  scene.M = Matrix(Matrix::Ones(2, 2));
  scene.g = [](double t, Eigen::Ref<Vector> v) {
    v[0] = -1;
    v[1] = -1 + std::max(0.0, t - 1);
  };
  scene.x0 = Vector::Zero(1);
  scene.T = 2;
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {1}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  const auto x = [](double t) { return (1 - std::exp(-2 * t)) / 2; };
  EXPECT_NEAR(s.x(2, true)[0], x(2), 1e-9);
  EXPECT_NEAR(s.y(0.5, true)[0], s.y(0.5, true)[1], 1e-10);
  EXPECT_NEAR(s.y(1.5, true)[0], 1 - x(1.5), 1e-9);
  EXPECT_EQ(s.y(1.5, true)[1], 0);
}

// Collocation with many short steps: rounding does not add up. x' = A x rotates; 2e4 steps.
TEST(EventDriven, ManyStepsDoNotAddUpRounding) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {-1, 0}}, Matrix{{0}, {0}}, Matrix{{0, 0}}};
  scene.M = Matrix{{1}};
  scene.g = [](double, Eigen::Ref<Vector> v) { v[0] = 1; };
  scene.x0 = Vector{{1, 0}};
  scene.T = 1;
  EventOptions options;
  options.longest_step = 5e-5;
  const EventSolution s = integrate_with_events(scene, LcpClass::P, {}, options);
  ASSERT_TRUE(s.complete) << s.reason;
  EXPECT_GE(s.pieces.size(), 20000u);
  // Each step rounds both components of x once, by epsilon / 2 at most.
  EXPECT_LE((s.x(1, true) - Vector{{std::cos(1.0), -std::sin(1.0)}}).norm(), 20000 * epsilon / std::sqrt(2.0));
}

// x' = v, v' = -x - 1/2 + y, x >= 0 from rest at 1: x = 3/2 cos t - 1/2 meets the stop at t = acos(1/3) with v =
// -sqrt(2) and stays there with y = 1/2.
TEST(EventDriven, AnOscillatorComesToRestAtAStop) {
  Scene scene = ball(1);
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {-1, 0}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  scene.f = [](double, Eigen::Ref<Vector> v) { v << 0, -0.5; };
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  const double hit = std::acos(1.0 / 3);
  EXPECT_EQ(s.jumps, 1);
  EXPECT_NEAR(s.x(1.2, true)[0], 1.5 * std::cos(1.2) - 0.5, 1e-9);
  EXPECT_NEAR(s.x(2, true).norm(), 0, 1e-9);
  EXPECT_NEAR(s.integral_of_y(3, true)[0], std::sqrt(2.0) + 0.5 * (3 - hit), 1e-9);
}

// x' = -x - 1 + y, w = x, x0 = -1: at t = 0 an impulse of 1 lifts the state to 0, where y = 1 holds it.
TEST(EventDriven, TheStateJumpsAtZero) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{0}};
  scene.f = [](double, Eigen::Ref<Vector> v) { v[0] = -1; };
  scene.x0 = Vector{{-1}};
  scene.T = 1;
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  ASSERT_EQ(s.jump_at_start.size(), 1);
  EXPECT_NEAR(s.jump_at_start[0], 1, 1e-9);
  EXPECT_NEAR(s.x(0.5, true)[0], 0, 1e-9);
  EXPECT_NEAR(s.y(0.5, true)[0], 1, 1e-9);
}

// x' = -x / 0.8 + f with a pulse of f between 0.2754 and 0.2902, which no coarse grid has a point in.
TEST(EventDriven, ANarrowPulseCounts) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1.25}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{0}};
  scene.f = [](double t, Eigen::Ref<Vector> v) { v[0] = t >= 0.2754 && t < 0.2902 ? 175.676 : 0; };
  scene.g = [](double, Eigen::Ref<Vector> v) { v[0] = 1; };
  scene.x0 = Vector{{0}};
  scene.T = 1;
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {0.2754, 0.2902}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  const double exact = 175.676 * 0.8 * (std::exp(-1.25 * (1 - 0.2902)) - std::exp(-1.25 * (1 - 0.2754)));
  EXPECT_NEAR(s.x(1, true)[0], exact, 1e-9);
}

// y = -g with a kink close before T, which no breakpoint names: y falls by 6e-3 in the last 6e-6.
TEST(EventDriven, AKinkBetweenTheLastSampleAndTheEndCounts) {
  constexpr double kink = 1 - 6e-6, slope = 1000;
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{0}}};
  scene.M = Matrix{{1}};
  scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = -1 + slope * std::max(0.0, t - kink); };
  scene.x0 = Vector{{0}};
  scene.T = 1;
  const EventSolution s = integrate_with_events(scene, LcpClass::P, {}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  EXPECT_NEAR(s.y(1, true)[0], 1 - slope * (1 - kink), 1e-8);  // the tolerance of sources times the slope
}

// x' = y, w = x - y, x0 = 1: y = 0 and y = x both continue.
TEST(EventDriven, TwoSolutionsAreNoSolution) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{-1}};
  scene.x0 = Vector{{1}};
  scene.T = 1;
  const EventSolution s = integrate_with_events(scene, LcpClass::unknown, {}, {});
  EXPECT_FALSE(s.complete);
  EXPECT_NE(s.reason.find("not unique"), std::string::npos) << s.reason;
}

// x1' = 1e10 (x2 - x1 + y), x2' = 1e10 (x1 - x2) - x2, 0 <= y, x1 + y >= 1 + sin t: y holds both at 1 + sin t by values
// of 3e-10, far below what counts as zero beside g, until that falls faster than e^{-t/2}. y = 0 from there on has to
// be seen, or the method has to give up.
TEST(EventDriven, GivesUpWhereAStiffStateHangsOnTheSignOfY) {
  const double k = 1e10;
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-k, k}, {k, -k - 1}}, Matrix{{k}, {0}}, Matrix{{1, 0}}};
  scene.M = Matrix{{1}};
  scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = -1 - std::sin(t); };
  scene.x0 = Vector::Zero(2);
  scene.T = 3;
  const EventSolution s = integrate_with_events(scene, LcpClass::P, {}, {});
  // 1 + sin t falls by its half from t with cos t = -(1 + sin t) / 2: sin t = 3/5, and 8/5 e^{-(T - t)/2} is left.
  const double leaves = std::numbers::pi - std::asin(0.6);
  if (s.complete)
    EXPECT_NEAR(s.x(scene.T, true)[1], 1.6 * std::exp(-(scene.T - leaves) / 2), 1e-6);
  else
    EXPECT_NE(s.reason.find("rounding decides"), std::string::npos) << s.reason;
}

// y = (sin t - x) / M is the difference of terms 1/M times as large. Within M it is x' + x where x = sin t.
Scene follows_a_sine(double M) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{M}};
  scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = -std::sin(t); };
  scene.x0 = Vector{{0}};
  scene.T = 1;
  return scene;
}

TEST(EventDriven, GivesUpWhereRoundingDecidesTheSignOfY) {
  const EventSolution s = integrate_with_events(follows_a_sine(1e-11), LcpClass::P, {}, {});
  EXPECT_FALSE(s.complete);
  EXPECT_NE(s.reason.find("rounding decides"), std::string::npos) << s.reason;
}

TEST(EventDriven, LargerAndSmallerMLeaveTheSignOfYKnown) {
  for (const double M : {1e-6, 1e-9, 1e-12, 1e-13}) {
    const Scene scene = follows_a_sine(M);
    const EventSolution s = integrate_with_events(scene, LcpClass::P, {}, {});
    ASSERT_TRUE(s.complete) << M << " " << s.reason;
    for (const double t : {0.2, 0.7, 1.0}) EXPECT_NEAR(s.x(t, true)[0], std::sin(t), 3 * M + 1e-10) << M;
    const double rounding_of_y = M > 1e-11 ? epsilon / M : 0;  // a smaller M is zero
    EXPECT_NEAR(s.integral_of_y(1, true)[0], 1 + std::sin(1.0) - std::cos(1.0), 3 * M + rounding_of_y + 1e-9) << M;
  }
}

// M = 1e-17 is rounding of what y moves within T, and zero: y = x' + x where x = sin t.
TEST(EventDriven, AnMOfRoundingIsZero) {
  const Scene scene = follows_a_sine(1e-17);
  const EventSolution s = integrate_with_events(scene, LcpClass::P, {}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  for (const double t : {0.2, 0.7, 1.0}) {
    EXPECT_NEAR(s.x(t, true)[0], std::sin(t), 1e-10);
    EXPECT_NEAR(s.y(t, true)[0], std::cos(t) + std::sin(t), 1e-8);
  }
}

// A body on its floor, with a place and a speed that rounding has left.
TEST(EventDriven, RoundingOfARestIsNoMotion) {
  Scene scene = ball(0);
  for (const double place : {1e-15, -1e-15})
    for (const double speed : {1e-16, -1e-16}) {
      scene.x0 = Vector{{place, speed}};
      const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, {});
      ASSERT_TRUE(s.complete) << s.reason;
      EXPECT_LT(s.x(scene.T, true).cwiseAbs().maxCoeff(), 1e-14);
      EXPECT_NEAR(s.y(scene.T, true)[0], 1, 1e-9);
    }
}

// w = x + g, g drops at 1/2 so that w would be -2e-5, and rises by 10 t from there: the state jumps by 2e-5, a contact
// that ends at once.
TEST(EventDriven, AnImpulseSmallerThanWhatSourcesMoveSoon) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{0}};
  scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = t < 0.5 ? -0.5 : -1 - 2e-5 + 10 * (t - 0.5); };
  scene.x0 = Vector{{1}};
  scene.T = 1;
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {0.5}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  EXPECT_EQ(s.jumps, 1);
  EXPECT_NEAR(s.x(1, true)[0], 1 + 2e-5, 1e-12);
}

// M = diag(1, 0), y and w the parts of sin(2 pi t + c). Their kinks are named 1e-9 too early: no active set holds on
// both sides of the true ones.
TEST(EventDriven, KinksOfSourcesMayBeKnownToNineDigits) {
  const Vector c{{0.3, 1.3}};
  const auto s = [c](double t) { return Vector((2 * std::numbers::pi * t + c.array()).sin()); };
  const Matrix B{{1, 0.2}, {0.3, 1}};
  Scene scene;
  scene.dynamics = DenseDynamics{-Matrix::Identity(2, 2), B, B.transpose()};
  scene.M = Matrix{{1, 0}, {0, 0}};
  // x = (1, 1): f = x - B y, g = w - N x - M y.
  scene.f = [=](double t, Eigen::Ref<Vector> v) { v = Vector::Ones(2) - B * s(t).cwiseMax(0); };
  scene.g = [=](double t, Eigen::Ref<Vector> v) {
    v = (-s(t)).cwiseMax(0) - B.transpose() * Vector::Ones(2) - s(t).cwiseMax(0).cwiseProduct(Vector::Unit(2, 0));
  };
  scene.x0 = Vector::Ones(2);
  scene.T = 2;
  std::vector<double> kinks;
  for (int k = 1; k <= 4; ++k)
    for (const double phase : c) kinks.push_back((k - phase / std::numbers::pi) / 2 - 1e-9);
  std::sort(kinks.begin(), kinks.end());
  const EventSolution e = integrate_with_events(scene, LcpClass::PSD, kinks, {});
  ASSERT_TRUE(e.complete) << e.reason;
  for (const double t : {0.2, 0.7, 1.1, 2.0}) {
    EXPECT_LE((e.x(t, true) - Vector::Ones(2)).norm(), 1e-8)
        << t;  // the kinks are known to 1e-9, and y changes by 2 pi
    EXPECT_LE((e.y(t, true) - s(t).cwiseMax(0)).norm(), 1e-7) << t;
  }
}

// x' = -50 x + 50 y, w = x + r y + g, where g falls from 1 to -1 in a time d: edges of pulses are this steep. Contact
// begins in the middle of it, at s = 0, and with l = 50 (1 + 1/r), c = 50/r
//     x = 2c/d (s/l - (1 - e^{-l s})/l^2) up to s = d/2,    then x' = -l x + c,    y = -(x + g)/r.
TEST(EventDriven, EdgesMayBeAsSteepAsRoundingOfTimeAllows) {
  constexpr double r = 0.013, from = 0.201, l = 50 * (1 + 1 / r), c = 50 / r;
  for (const double d : {1e-6, 6e-8, 1e-9, 1e-11}) {
    Scene scene;
    scene.dynamics = DenseDynamics{Matrix{{-50}}, Matrix{{50}}, Matrix{{1}}};
    scene.M = Matrix{{r}};
    scene.g = [d](double t, Eigen::Ref<Vector> v) { v[0] = std::clamp(1 - 2 * (t - from) / d, -1.0, 1.0); };
    scene.x0 = Vector::Zero(1);
    scene.T = 1;
    const EventSolution e = integrate_with_events(scene, LcpClass::P, {from, from + d}, {});
    ASSERT_TRUE(e.complete) << d << ": " << e.reason;
    EXPECT_LE(e.events, 4) << d;  // rounding makes no contacts of its own, one after the other
    const double at_end = 2 * c / d * (d / 2 / l - (-std::expm1(-l * d / 2)) / (l * l));
    for (const double later : {1e-5, 1e-3, 0.1}) {
      const double x = c / l + (at_end - c / l) * std::exp(-l * later), t = from + d + later;
      // EventOptions::tolerance, and d e^{-l s} is known to rounding of t alone.
      EXPECT_NEAR(e.x(t, true)[0], x, 1e-9) << d;
      EXPECT_NEAR(e.y(t, true)[0], (1 - x) / r, 1e-9 / r) << d;
    }
  }
}

TEST(EventDriven, CountsTheValuesOfSourcesAsWork) {
  Scene scene = ball(0.5);
  scene.g = [](double, Eigen::Ref<Vector> v) { v.setZero(); };
  EventOptions options;
  options.most_work = 1e6;  // 16384 values looked at, of 3 components, cost more
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, options);
  EXPECT_FALSE(s.complete);
  EXPECT_EQ(s.end, EventEnd::out_of_work) << s.reason;
}

TEST(EventDriven, EndsWithAReason) {
  EventOptions options;
  options.most_work = 1;
  const EventSolution worked = integrate_with_events(ball(0.5), LcpClass::PSD, {}, options);
  EXPECT_FALSE(worked.complete);
  EXPECT_EQ(worked.end, EventEnd::out_of_work) << worked.reason;
  options = {};
  options.interrupted = [] { return true; };
  const EventSolution stopped = integrate_with_events(ball(0.5), LcpClass::PSD, {}, options);
  EXPECT_TRUE(stopped.interrupted);
  EXPECT_FALSE(stopped.complete);
}

// What another integration has kept changes this one by rounding at most, of numbers about 1.
TEST(EventDriven, KeptRegimesChangeRoundingAlone) {
  constexpr double rounding = 1e-13;
  EventOptions options;
  options.kept = keep_regimes();
  for (const double tolerance : {1e-8, 1e-11, 1e-8})
    for (const double height : {0.5, 0.25, 1.0}) {
      Scene scene = ball(height);
      scene.restitution = Vector::Constant(1, 0.5);
      options.tolerance = tolerance;
      const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, options);
      EventOptions alone = options;
      alone.kept.reset();
      const EventSolution other = integrate_with_events(scene, LcpClass::PSD, {}, alone);
      ASSERT_TRUE(s.complete) << s.reason;
      ASSERT_EQ(s.pieces.size(), other.pieces.size());
      for (std::size_t k = 0; k < s.pieces.size(); ++k) {
        EXPECT_NEAR(s.pieces[k].begin, other.pieces[k].begin, rounding);
        EXPECT_LE((s.pieces[k].x - other.pieces[k].x).cwiseAbs().maxCoeff(), rounding);
        EXPECT_LE((s.pieces[k].y - other.pieces[k].y).cwiseAbs().maxCoeff(), rounding);
      }
    }
}

TEST(EventDriven, AgreesWithTheOracle) {
  int compared = 0;
  for (std::uint32_t seed = 700; seed < 740; ++seed) {
    const oracle::SourceScene random = oracle::source_scene(seed);
    const oracle::EventSolution truth = oracle::locate_events(random.base);
    if (!truth.decided) continue;
    const oracle::DenseScene& base = random.base.scene;
    Scene scene;
    DenseDynamics d;
    d.A = base.A;
    d.B = base.B;
    d.N = base.N;
    scene.dynamics = d;
    scene.M = base.M;
    scene.f = base.f;
    scene.g = base.g;
    scene.x0 = base.x0;
    scene.T = base.T;
    EventOptions options;
    options.tolerance = 1e-11;
    const EventSolution s = integrate_with_events(scene, base.lcp_class, random.base.breaks, options);
    if (!s.complete) {
      EXPECT_NE(s.reason, "") << seed;
      continue;
    }
    ++compared;
    const Vector size = oracle::measure(truth.largest_x());
    for (int k = 1; k <= 50; ++k) {
      const double t = base.T * (k - 0.381966) / 50;
      EXPECT_LE((s.x(t, true) - truth.x(t, true)).cwiseQuotient(size).cwiseAbs().maxCoeff(), 1e-7) << seed;
    }
  }
  EXPECT_GE(compared, 20);
}

}  // namespace
}  // namespace bromwich

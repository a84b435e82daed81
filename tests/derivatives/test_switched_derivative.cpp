// Derivatives through located switches: against solutions by hand, the transpose, and differences of the independent
// event-located oracle on random scenes. BROMWICH_RANDOM_SCENES sets their number (default 300),
// BROMWICH_FIRST_SCENE the first seed.

#include "derivatives/switched_derivative.hpp"

#include "core/base/error.hpp"
#include "core/scene/relay.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/random_sources.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <numbers>
#include <optional>
#include <string>
#include <utility>

namespace bromwich::switched_test {
namespace {

using reference::Random;

double dot(const RowMatrix& a, const RowMatrix& b) { return a.cwiseProduct(b).sum(); }

Scene relay(double push, double x0) {
  Scene s = relay_scene(
      Matrix{{0}}, Matrix{{1}}, Matrix{{1}}, [push](double, Eigen::Ref<Vector> v) { v[0] = push; }, Vector{{x0}});
  s.T = 1;
  return s;
}

Scene ball(double height, double speed) {
  Scene s;
  s.dynamics = DenseDynamics{Matrix{{0, 1}, {0, 0}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  s.M = Matrix(Matrix::Zero(1, 1));
  s.x0 = Vector{{height, speed}};
  s.f = [](double t, Eigen::Ref<Vector> v) { v << 0, -1 + 0.75 * t * t * t * t; };
  s.T = 2;
  return s;
}

SolutionChange by_x0(const Scene& scene, const Vector& direction, Index steps = 10) {
  DataChange c;
  c.x0 = direction;
  return SwitchedDerivative(scene, Vector::LinSpaced(steps + 1, 0, scene.T)).jvp(c);
}

// x' = 2 - sgn x: x' = 3 below 0 and 1 above.
TEST(SwitchedDerivative, OfARelayThatCrosses) {
  EXPECT_NEAR(by_x0(relay(2, -1), Vector{{1}}).x(10, 0), 1.0 / 3, 1e-12);
  EXPECT_NEAR(by_x0(relay(2, 0.5), Vector{{1}}).x(10, 0), 1, 1e-12);
  // From above: x' = -2 - sgn x is -3 above 0 and -1 below.
  EXPECT_NEAR(by_x0(relay(-2, 1), Vector{{1}}).x(10, 0), 1.0 / 3, 1e-12);
  const SwitchedDerivative d(relay(2, -1), Vector::LinSpaced(11, 0, 1));
  ASSERT_EQ(d.switches().size(), 1u);
  EXPECT_NEAR(d.switches()[0], 1.0 / 3, 1e-10);
  EXPECT_NEAR(d.margin().transversality, 3, 1e-6) << "|c'| T over the largest -x = 1";
}

// x' = 1/2 - sgn x slides along x = 0: its start is forgotten, and y = s holds the push.
TEST(SwitchedDerivative, OfARelayThatSlides) {
  const Scene scene = relay(0.5, -0.35);
  const SwitchedDerivative d(scene, Vector::LinSpaced(11, 0, 1));
  DataChange c;
  c.x0 = Vector{{1}};
  EXPECT_NEAR(d.jvp(c).x(10, 0), 0, 1e-12);
  EXPECT_EQ(d.jvp(c).x(2, 0), 1) << "before the switch at 0.35/1.5";
  c = {};
  c.f = RowMatrix::Ones(11, 1);
  EXPECT_NEAR(d.jvp(c).y(10, 0), 0.5, 1e-10) << "lambda = 1 - 2 s = -f";
  // The integral of s: 0 before t* = -x0/1.5 and (1 + f)/2 after, f = 1/2.
  c = {};
  c.x0 = Vector{{1}};
  EXPECT_NEAR(d.jvp(c).integral(10, 0), 0.75 / 1.5, 1e-9) << "t* moves by -1/1.5";
  EXPECT_NE(d.without_M(), "");
  c = {};
  c.M = Matrix::Identity(2, 2);
  EXPECT_NE(refusal([&] { d.jvp(c); }), "nothing was refused");
  SolutionChange of;
  of.x = RowMatrix::Ones(11, 1);
  EXPECT_EQ(d.vjp(of).M.size(), 0);
}

// An inelastic impact on a floor, and the release: the impulse is the speed at the impact.
TEST(SwitchedDerivative, OfAnImpact) {
  const auto impulse = [](double height, double speed) {
    return SwitchedDerivative(ball(height, speed), Vector{{0, 1, 2}}).values().integral(1, 0);
  };
  const SwitchedDerivative d(ball(0.3, 0.1), Vector{{0, 1, 2}});
  DataChange c;
  c.x0 = Vector{{1, 0}};
  const SolutionChange by_height = d.jvp(c);
  c.x0 = Vector{{0, 1}};
  const SolutionChange by_speed = d.jvp(c);
  const double step = 1e-5;
  EXPECT_NEAR(by_height.integral(1, 0), (impulse(0.3 + step, 0.1) - impulse(0.3 - step, 0.1)) / (2 * step), 1e-6);
  EXPECT_NEAR(by_speed.integral(1, 0), (impulse(0.3, 0.1 + step) - impulse(0.3, 0.1 - step)) / (2 * step), 1e-6);
  EXPECT_NEAR(by_height.x.row(2).norm(), 0, 1e-9) << "the floor forgets the start";
}

// x' = -cos t + y falls onto 0 and stays there until cos t < 0. What a reduction of larger equations leaves of M = 0 is
// zero for the solution and for its derivative.
TEST(SwitchedDerivative, OfAnObstacleWithRoundingInM) {
  const Vector t{{0, 1, 3}};
  const auto by_start = [&t](double M) {
    Scene s;
    s.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{1}}, Matrix{{1}}};
    s.M = Matrix{{M}};
    s.f = [](double at, Eigen::Ref<Vector> v) { v[0] = -std::cos(at); };
    s.x0 = Vector{{0.5}};
    s.T = 3;
    DataChange c;
    c.x0 = Vector{{1}};
    return SwitchedDerivative(s, t).jvp(c);
  };
  const SolutionChange found = by_start(1e-17), expected = by_start(0);
  EXPECT_NEAR(found.integral(1, 0), -1, 1e-9) << "the obstacle takes what is above it";
  EXPECT_EQ(found.integral, expected.integral);
  EXPECT_EQ(found.x, expected.x);
}

TEST(SwitchedDerivative, SaysWhereThereIsNone) {
  const Vector t{{0, 0.5, 1}};
  // At rest on the switch: x = 0 and lambda within its bounds.
  EXPECT_NE(refusal([&] { SwitchedDerivative(relay(2, 0), t); }).find("not differentiable here"), std::string::npos);
  // The state touches x = 0 without crossing: x = (t - 1/2)^2.
  Scene touch;
  touch.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{1}}, Matrix{{1}}};
  touch.M = Matrix{{0}};
  touch.x0 = Vector{{0.25}};
  touch.f = [](double s, Eigen::Ref<Vector> v) { v[0] = 2 * s - 1; };
  touch.T = 1;
  EXPECT_NE(refusal([&] { SwitchedDerivative(touch, t); }).find("not differentiable here"), std::string::npos);
  // Rows at a switch are one-sided.
  const SwitchedDerivative d(relay(2, -1.5), t);
  ASSERT_EQ(d.one_sided(), std::vector<Index>{1});
  SolutionChange of;
  of.x = RowMatrix::Ones(3, 1);
  EXPECT_NE(refusal([&] { d.vjp(of); }).find("at a switch"), std::string::npos);
  of.x(1, 0) = 0;
  EXPECT_NEAR(d.vjp(of).x0[0], 1 + 1.0 / 3, 1e-12);
}

// Two equal relays cross at the same time: x' = 2 - sgn x for both. No derivative is one along all changes; along those
// of both there is that of one relay. Two balls that meet the floor at once have none: impacts do not commute in
// general.
TEST(SwitchedDerivative, AlongChangesThatKeepASymmetry) {
  Scene two = relay_scene(
      Matrix::Zero(2, 2), Matrix::Identity(2, 2), Matrix::Identity(2, 2),
      [](double, Eigen::Ref<Vector> v) { v.setConstant(2); }, Vector{{-1, -1}});
  two.T = 1;
  const Vector t = Vector::LinSpaced(11, 0, 1);
  EXPECT_NE(refusal([&] { SwitchedDerivative(two, t); }).find("not differentiable here"), std::string::npos);
  const SwitchedDerivative both(two, t, true);
  EXPECT_NE(both.only_along(), "");
  DataChange c;
  c.x0 = Vector{{1, 1}};
  EXPECT_LE((both.jvp(c).x.row(10) - Eigen::RowVector2d::Constant(1.0 / 3)).norm(), 1e-10);
  c.x0 = Vector{{1, 0.9}};
  EXPECT_NE(refusal([&] { both.jvp(c); }).find("not differentiable here"), std::string::npos);
  SolutionChange of;
  of.x = RowMatrix::Ones(11, 2);
  EXPECT_NE(refusal([&] { both.vjp(of); }).find("ask for jvp along other changes"), std::string::npos);
  Scene balls = ball(0.3, 0.1);
  DenseDynamics d{Matrix::Zero(4, 4), Matrix::Zero(4, 2), Matrix::Zero(2, 4)};
  d.A(0, 1) = d.A(2, 3) = d.B(1, 0) = d.B(3, 1) = d.N(0, 0) = d.N(1, 2) = 1;
  balls.dynamics = d;
  balls.M = Matrix(Matrix::Zero(2, 2));
  balls.x0 = Vector{{0.3, 0.1, 0.3, 0.1}};
  balls.f = [](double s, Eigen::Ref<Vector> v) { v << 0, -1 + 0.75 * s * s * s * s, 0, -1 + 0.75 * s * s * s * s; };
  EXPECT_NE(refusal([&] { SwitchedDerivative(balls, 2 * t, true); }).find("not differentiable here"),
            std::string::npos);
}

// A boost converter in continuous conduction, as examples/boost.toml. While the switch is off both bounds of its
// current are 0, so that y_2 = w_2 = 0 for a while. x follows two linear modes between times that are known.
struct Boost {
  double Vin = 1, L = 0.5, C = 0.8, R = 2, off = 0.5;
  Vector x0 = Vector{{1.4, 1.7}};

  static constexpr double T = 2.8;
  static double gate(double t, double off) {
    const double phase = t - std::floor(t);
    return phase >= 0.1 && phase < off ? 1 : 0;
  }
  std::vector<double> edges() const { return {0.1, off, 1.1, 1 + off, 2.1, 2 + off}; }

  Scene scene() const {
    Scene s;
    s.dynamics = DenseDynamics{Matrix{{0, 0}, {0, -1 / (R * C)}}, Matrix{{0, -1 / L, 1 / L}, {1 / C, 0, 0}},
                               Matrix{{0, 1}, {-1, 0}, {1, 0}}};
    s.M = Matrix{{0, -1, 1}, {1, 0, 0}, {-1, 0, 0}};
    s.f = [Vin = Vin, L = L](double, Eigen::Ref<Vector> v) { v << Vin / L, 0; };
    s.g = [off = off](double t, Eigen::Ref<Vector> v) { v << 0, 100 * gate(t, off), 0; };
    s.x0 = x0;
    s.T = T;
    s.breakpoints = edges();
    s.breakpoints_are_all = true;
    return s;
  }

  // x at the time, through both modes in turn.
  Vector at(double t) const {
    Vector z{{x0[0], x0[1], 1}};
    double from = 0;
    bool on = false;
    std::vector<double> until = edges();
    until.push_back(T);
    for (const double to : until) {
      const Matrix A = on ? Matrix{{0, 0, Vin / L}, {0, -1 / (R * C), 0}, {0, 0, 0}}
                          : Matrix{{0, -1 / L, Vin / L}, {1 / C, -1 / (R * C), 0}, {0, 0, 0}};
      z = (oracle::exponential(A * (std::min(t, to) - from)) * z).eval();
      if (t <= to) break;
      from = to;
      on = !on;
    }
    return z.head(2);
  }
};

TEST(SwitchedDerivative, OfAConverterWhoseGateIsClosed) {
  const Vector t = Vector::LinSpaced(29, 0, Boost::T);
  const Boost given;
  EXPECT_NE(refusal([&] { SwitchedDerivative(given.scene(), t); }).find("y_2 = w_2 = 0"), std::string::npos);
  const SwitchedDerivative d(given.scene(), t, true);
  EXPECT_LE((d.values().x.row(28).transpose() - given.at(Boost::T)).norm(), 1e-9);
  const Index rows = t.size();
  const auto expect = [&](const char* name, const DataChange& c, const std::vector<MovingJump>& jumps, auto change) {
    const double step = 1e-5;
    const SolutionChange out = d.jvp(c, jumps);
    for (const Index j : {Index(4), Index(7), Index(16), Index(28)}) {
      Boost up = given, down = given;
      change(up, step);
      change(down, -step);
      const Vector difference = (up.at(t[j]) - down.at(t[j])) / (2 * step);
      EXPECT_LE((out.x.row(j).transpose() - difference).norm(), 1e-8 * (1 + difference.norm())) << name << " " << j;
    }
  };
  DataChange c;
  c.x0 = Vector{{1, -0.5}};
  expect("x0", c, {}, [](Boost& b, double by) { b.x0 += by * Vector{{1, -0.5}}; });
  c = {};
  c.f = RowMatrix::Zero(rows, 2);
  c.f.col(0).setConstant(1 / given.L);
  expect("Vin", c, {}, [](Boost& b, double by) { b.Vin += by; });
  c = {};
  c.A = Matrix{{0, 0}, {0, 1 / (given.R * given.R * given.C)}};
  expect("R", c, {}, [](Boost& b, double by) { b.R += by; });
  c.A *= given.R / given.C;
  c.B = Matrix{{0, 0, 0}, {-1 / (given.C * given.C), 0, 0}};
  expect("C", c, {}, [](Boost& b, double by) { b.C += by; });
  expect("duty", {}, {{0.5, 1}, {1.5, 1}, {2.5, 1}}, [](Boost& b, double by) { b.off += by; });
  // The bounds of the current move apart, or exclude each other.
  c = {};
  c.g = RowMatrix::Ones(rows, 3);
  EXPECT_NE(refusal([&] { d.jvp(c); }).find("not differentiable here"), std::string::npos);
  c = {};
  c.N = Matrix{{0, 0}, {-1, 0}, {0, 0}};
  EXPECT_NE(refusal([&] { d.jvp(c); }).find("not differentiable here"), std::string::npos);
  c.N = Matrix{{0, 0}, {-1, 0}, {1, 0}};  // both bounds stay equal
  EXPECT_TRUE(d.jvp(c).x.allFinite());
}

// Gradients by the data on which nothing depends that has to stay zero.
TEST(SwitchedDerivative, GradientsOfAConverterWhoseGateIsClosed) {
  const Vector t = Vector::LinSpaced(29, 0, Boost::T);
  const SwitchedDerivative d(Boost().scene(), t, true);
  Random random(3);
  const SolutionChange of{random.matrix(29, 3), random.matrix(29, 2), {}, random.matrix(29, 3)};
  const DataChange bar = d.vjp(of);
  // The two bounds of the closed gate push against each other: B has to change alike for both.
  for (const Matrix* left_out : {&bar.B, &bar.N, &bar.M}) EXPECT_EQ(left_out->size(), 0);
  EXPECT_EQ(bar.g.size(), 0);
  DataChange c;
  c.x0 = random.vector(2), c.f = random.matrix(29, 2), c.A = random.matrix(2, 2);
  const SolutionChange out = d.jvp(c);
  const double forward = dot(of.y, out.y) + dot(of.x, out.x) + dot(of.integral, out.integral);
  const double backward = bar.x0.dot(c.x0) + dot(bar.f, c.f) + bar.A.cwiseProduct(c.A).sum();
  EXPECT_NEAR(
      forward, backward,
      1e-12 * (of.y.norm() * out.y.norm() + of.x.norm() * out.x.norm() + of.integral.norm() * out.integral.norm()));
}

// E x' = A x + B y: the same as with E^{-1} A and E^{-1} B, and its derivative with respect to E.
// An impulse at t = 0 puts the state on the constraint, to rounding, where nothing moves it: y = w = 0 from there on,
// and a push either leaves it or is held.
TEST(SwitchedDerivative, RestsWhereAnImpulseHasPutIt) {
  Scene s;
  s.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{0.18533}}, Matrix{{0.18533}}};
  s.M = Matrix(Matrix::Zero(1, 1));
  s.T = 1;
  for (const double x0 : {-0.674155, -1.0, -3.3e5}) {
    s.x0 = Vector{{x0}};
    const std::string why = refusal([&] { SwitchedDerivative(s, Vector::LinSpaced(5, 0, 1)); });
    EXPECT_NE(why.find("y_0 = w_0 = 0"), std::string::npos) << x0 << ": " << why;
  }
}

TEST(SwitchedDerivative, WithAMassMatrix) {
  const auto with = [](double mass) {
    Scene s = ball(0.3, 0.1);
    s.T = 1.5;
    DenseDynamics d = *s.dynamics->small_state();
    d.E = Matrix{{1, 0.2}, {0, mass}};
    s.dynamics = d;
    return s;
  };
  const Vector t{{0, 0.4, 1.1, 1.5}};
  const SwitchedDerivative d(with(2), t);
  DataChange c;
  c.E = Matrix{{0, 0}, {0, 1}};
  const SolutionChange change = d.jvp(c);
  const double step = 1e-5;
  const SwitchedDerivative up(with(2 + step), t), down(with(2 - step), t);
  EXPECT_LE((change.x - (up.values().x - down.values().x) / (2 * step)).cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_LE((change.integral - (up.values().integral - down.values().integral) / (2 * step)).cwiseAbs().maxCoeff(),
            1e-6);
  SolutionChange of;
  of.x = RowMatrix::Ones(4, 2);
  EXPECT_NEAR(d.vjp(of).E(1, 1), change.x.sum(), 1e-11);
}

// Modes with memory.

// x' = -x, and `heat` more from x < low until x > 1.1.
Scene thermostat(double low, double x0, double heat = 2) {
  Scene s;
  s.dynamics = DenseDynamics{Matrix{{-1}}, Matrix(1, 0), Matrix(0, 1)};
  s.M = Matrix(0, 0);
  s.x0 = Vector{{x0}};
  s.T = 0.5;
  const TimeFunction f = [heat](double, Eigen::Ref<Vector> v) { v[0] = heat; };
  s.memories = {{"heater",
                 {{.name = "off", .leave = {{"on", {Memory::below(0, low, 1)}}}},
                  {.name = "on", .f = f, .leave = {{"off", {Memory::above(0, 1.1, 1)}}}}}}};
  s.breakpoints_are_all = true;
  return s;
}

// Off until x = 0.9 at t1 = ln(x0 / 0.9), then x = 2 - 1.1 e^{t1 - t}, to x = 1.1 at t1 + ln(1.1 / 0.9).
TEST(SwitchedDerivative, OfAThermostat) {
  const Vector t = Vector::LinSpaced(11, 0, 0.5);
  const SwitchedDerivative d(thermostat(0.9, 1), t);
  const double t1 = std::log(1 / 0.9), t2 = t1 + std::log(1.1 / 0.9);
  ASSERT_EQ(d.switches().size(), 2u);
  EXPECT_NEAR(d.switches()[0], t1, 1e-10);
  EXPECT_EQ(d.modes().size(), 2u);
  DataChange c;
  c.x0 = Vector{{1}};
  const SolutionChange by_x0 = d.jvp(c);  // t1 moves by 1
  c = {};
  c.f = RowMatrix::Ones(11, 1);  // x' = f - x: t1 moves by 1/0.9 - 1, and t2 - t1 by 1/1.1 - 1/0.9
  const SolutionChange by_f = d.jvp(c);
  for (Index j = 0; j < 11; ++j) {
    const double s = t[j], on = std::exp(t1 - s), off = std::exp(t2 - s), moved = 1 / 0.9 - 1;
    EXPECT_NEAR(by_x0.x(j, 0), s < t1 ? std::exp(-s) : s < t2 ? -1.1 * on : 1.1 * off, 1e-9) << s;
    EXPECT_NEAR(by_f.x(j, 0),
                s < t1   ? 1 - std::exp(-s)
                : s < t2 ? 1 - on - 1.1 * on * moved
                         : 1 - off + 1.1 * off * (moved + 1 / 1.1 - 1 / 0.9),
                1e-9)
        << s;
  }
  EXPECT_EQ(by_x0.y.cols(), 0);
  EXPECT_EQ(by_x0.x.cols(), 1) << "the mode is no state";
  SolutionChange of;
  of.x = RowMatrix::Zero(11, 1);
  of.x(10, 0) = 1;
  const DataChange gradient = d.vjp(of);
  EXPECT_NEAR(gradient.x0[0], by_x0.x(10, 0), 1e-11);
  EXPECT_NEAR(gradient.f.sum(), by_f.x(10, 0), 1e-11);
  EXPECT_EQ(gradient.A.size(), 1);
}

// v is set to 0.8 where x = 0, whatever it was.
TEST(SwitchedDerivative, OfAStateThatAMemorySets) {
  Scene s;
  s.dynamics = DenseDynamics{Matrix{{0, 1}, {0, 0}}, Matrix(2, 0), Matrix(0, 2)};
  s.M = Matrix(0, 0);
  s.f = [](double, Eigen::Ref<Vector> v) { v << 0, -1; };
  s.x0 = Vector{{0.5, 0.3}};
  s.T = 2;
  s.memories = {
      {"kick", {{.name = "before", .leave = {{"behind", {Memory::below(0, 0, 2)}, {{1, 0.8}}}}}, {.name = "behind"}}}};
  s.breakpoints_are_all = true;
  const SwitchedDerivative d(s, Vector::LinSpaced(5, 0, 2));
  const double v1 = -std::sqrt(0.09 + 1), t1 = 0.3 - v1;
  for (const auto& [direction, dt] : {std::pair(Vector{{1, 0}}, -1 / v1), {Vector{{0, 1}}, -t1 / v1}}) {
    DataChange c;
    c.x0 = direction;
    const SolutionChange change = d.jvp(c);
    EXPECT_NEAR(change.x(4, 1), dt, 1e-9) << "v = 0.8 - (t - t1)";
    EXPECT_NEAR(change.x(4, 0), -dt * (0.8 - (2 - t1)), 1e-9);
    SolutionChange of;
    of.x = RowMatrix::Zero(5, 2);
    of.x.row(4) << 0.7, -0.4;
    EXPECT_NEAR(d.vjp(of).x0.dot(direction), 0.7 * change.x(4, 0) - 0.4 * change.x(4, 1), 1e-11);
  }
}

// A relay with hysteresis, x' = u - x between -1/2 and 1/2, in its periodic state with x(0) on the way up:
// x(0) = x(T) holds for no other T, so that the inflow `bias` moves x(0).
TEST(SwitchedDerivative, OfAModeInADrivenPeriod) {
  const auto scene = [](double bias) {
    Scene s;
    s.dynamics = DenseDynamics{Matrix{{-1}}, Matrix(1, 0), Matrix(0, 1)};
    s.M = Matrix(0, 0);
    s.T = 2;
    s.f = [bias](double t, Eigen::Ref<Vector> v) { v[0] = bias + std::sin(std::numbers::pi * t); };
    const TimeFunction up = [](double, Eigen::Ref<Vector> v) { v[0] = 1; };
    s.memories = {{"relay",
                   {{.name = "down", .leave = {{"up", {Memory::below(0, -0.1, 1)}}}},
                    {.name = "up", .f = up, .leave = {{"down", {Memory::above(0, 0.4, 1)}}}}}}};
    s.breakpoints_are_all = true;
    s.boundary = BoundaryCondition{Matrix{{1}}, Matrix{{-1}}, Vector{{0}}};
    return s;
  };
  const Vector t = Vector::LinSpaced(9, 0, 2);
  const double bias = -0.4, step = 1e-5;
  const SwitchedDerivative d(scene(bias), t), up(scene(bias + step), t), down(scene(bias - step), t);
  ASSERT_GE(d.switches().size(), 2u);
  DataChange c;
  c.f = RowMatrix::Ones(9, 1);
  const RowMatrix found = d.jvp(c).x;
  // The error of differences: that of x, 1e-10, over the step, and its square.
  EXPECT_LE((found - (up.values().x - down.values().x) / (2 * step)).cwiseAbs().maxCoeff(), 1e-4);
  SolutionChange of;
  of.x = RowMatrix::Ones(9, 1);
  EXPECT_NEAR(d.vjp(of).f.sum(), found.sum(), 1e-9);
}

// Random scenes.

Scene scene_of(const oracle::EventScene& random) {
  const oracle::DenseScene& base = random.scene;
  Scene scene;
  DenseDynamics d;
  d.A = base.A;
  d.B = base.B;
  d.N = base.N;
  scene.dynamics = d;
  scene.M = base.M;
  scene.lcp_class = base.lcp_class;
  scene.f = base.f;
  scene.g = base.g;
  scene.x0 = base.x0;
  scene.T = base.T;
  scene.breakpoints = random.breaks;
  scene.breakpoints_are_all = true;
  return scene;
}

// Changes of x0, A, and constant ones of f and g.
DataChange drawn(std::uint32_t seed, const oracle::DenseScene& base, Index rows) {
  Random random(seed + 5000);
  const Index m = base.A.rows(), n = base.M.rows();
  DataChange c;
  c.x0 = random.vector(m);
  c.A = random.matrix(m, m);
  c.f = RowMatrix(Vector::Ones(rows) * random.vector(m).transpose());
  c.g = RowMatrix(Vector::Ones(rows) * random.vector(n).transpose());
  return c;
}

oracle::EventScene changed(const oracle::EventScene& given, const DataChange& c, double by) {
  oracle::EventScene other = given;
  oracle::DenseScene& s = other.scene;
  s.x0 += by * c.x0;
  s.A += by * c.A;
  const auto plus = [by](const TimeFunction& function, const Vector& more) -> TimeFunction {
    return [=](double t, Eigen::Ref<Vector> v) {
      v.setZero();
      if (function) function(t, v);
      v += by * more;
    };
  };
  s.f = plus(s.f, c.f.row(0).transpose());
  s.g = plus(s.g, c.g.row(0).transpose());
  return other;
}

// Central differences of x at the times; nothing where the oracle is undecided.
std::optional<RowMatrix> differences(const oracle::EventScene& scene, const DataChange& c, const Vector& t, double by) {
  const oracle::EventSolution up = oracle::locate_events(changed(scene, c, by));
  const oracle::EventSolution down = oracle::locate_events(changed(scene, c, -by));
  if (!up.decided || !down.decided) return std::nullopt;
  RowMatrix d(t.size(), scene.scene.A.rows());
  for (Index j = 0; j < t.size(); ++j) d.row(j) = (up.x(t[j], true) - down.x(t[j], true)).transpose() / (2 * by);
  return d;
}

constexpr double good_difference = 1e-4;  ///< five times what two steps of differences may be apart

struct Verdict {
  bool given = false, judged = false, good = true;
  std::string what;
};

Verdict verdict_of(std::uint32_t seed, bool along_some = false) {
  const oracle::SourceScene random = oracle::source_scene(seed);
  const oracle::DenseScene& base = random.base.scene;
  Verdict v;
  const Vector t = base.T * Vector{{0, 0.2763932, 0.5278640, 0.7639320, 1}};
  const Index m = base.A.rows(), n = base.M.rows();
  DataChange c = drawn(seed, base, t.size());
  if (along_some) c.x0.setZero(), c.g.setZero();  // they move w at once
  std::optional<SwitchedDerivative> d;
  SolutionChange forward;
  try {
    d.emplace(scene_of(random.base), t, along_some);
    forward = d->jvp(c);
  } catch (const Error& e) {
    v.what = e.what();
    return v;
  }
  v.given = true;
  Random weights(seed + 9000);
  SolutionChange of{weights.matrix(t.size(), n), weights.matrix(t.size(), m), weights.matrix(t.size(), n),
                    weights.matrix(t.size(), n)};
  for (const Index j : d->one_sided())
    for (RowMatrix* table : {&of.y, &of.x, &of.w}) table->row(j).setZero();
  DataChange bar;
  if (d->only_along().empty()) bar = d->vjp(of);
  const double value =
      dot(of.y, forward.y) + dot(of.x, forward.x) + dot(of.w, forward.w) + dot(of.integral, forward.integral);
  const double by_bar = d->only_along().empty()
                            ? bar.x0.dot(c.x0) + dot(bar.f, c.f) + dot(bar.g, c.g) + bar.A.cwiseProduct(c.A).sum()
                            : value;
  const double norm = std::sqrt(dot(of.y, of.y) + dot(of.x, of.x) + dot(of.w, of.w) + dot(of.integral, of.integral)) *
                      std::sqrt(dot(forward.y, forward.y) + dot(forward.x, forward.x) + dot(forward.w, forward.w) +
                                dot(forward.integral, forward.integral));
  // Rounding of some 10^4 operations, one after the other.
  if (!(std::abs(value - by_bar) <= 4e4 * epsilon * norm)) {
    v.good = false;
    v.what = "identity " + std::to_string(std::abs(value - by_bar) / norm * 1e12) + "e-12";
    return v;
  }
  // Differences that agree with the derivative need no second step. Others are trusted if two steps of them agree; both
  // lie within a hundredth of the margin, where no switch appears or vanishes. Shorter ones would be of the size of
  // what the oracle counts as zero, relative to the largest y.
  const double size = 1e-5 * std::min(1.0, 1e3 * d->margin().margin);
  const auto apart = [&](const RowMatrix& a, const RowMatrix& b) {
    return (a - b).cwiseAbs().maxCoeff() / (b.cwiseAbs().maxCoeff() + 1e-3 * c.x0.norm());
  };
  std::optional<RowMatrix> found = differences(random.base, c, t, size);
  if (!found) return v;
  if (!(apart(forward.x, *found) <= good_difference)) {
    const std::optional<RowMatrix> fine = differences(random.base, c, t, size / 3);
    if (!fine || !(apart(*found, *fine) <= 2e-5)) return v;
    found = fine;
  }
  v.judged = true;
  const double off = apart(forward.x, *found);
  v.good = off <= good_difference;
  v.what = "off by " + std::to_string(off) + " margin " + std::to_string(d->margin().margin * 1e6) + "e-6 trans " +
           std::to_string(d->margin().transversality) + " family " + std::to_string(int(random.family)) + " switches " +
           std::to_string(d->switches().size());
  return v;
}

// A component that touches zero between the samples of its polynomial. Differences to both sides are 0.44 apart, and
// the parabola through the samples had a margin of 2.7e-6.
// Two equal diodes side by side: their currents are not unique, x is. What treats them alike has a derivative, that of
// one diode with half the resistance of each. With other changes x depends on how they share the current.
TEST(SwitchedDerivative, WhereYIsNotUniqueAlongChangesThatDoNotTellItApart) {
  const auto circuit = [](const Matrix& B, const Matrix& N, const Matrix& M) {
    Scene s;
    s.dynamics = DenseDynamics{Matrix{{0, -1}, {1, 0}}, B, N};
    s.M = M;
    s.lcp_class = LcpClass::PSD;
    s.x0 = Vector{{1, 0}};
    s.T = 3.9;
    return s;
  };
  const Scene two = circuit(Matrix{{-1, -1}, {0, 0}}, Matrix{{-1, 0}, {-1, 0}}, Matrix{{0.5, 0.5}, {0.5, 0.5}});
  const Scene one = circuit(Matrix{{-1}, {0}}, Matrix{{-1, 0}}, Matrix{{0.5}});
  const Vector t = Vector::LinSpaced(21, 0, 3.9);
  const SwitchedDerivative of_two(two, t, true), of_one(one, t, true);
  DataChange alike, single;
  alike.A = single.A = Matrix{{0.1, 0.2}, {-0.3, 0.1}};
  alike.B = Matrix{{0.2, 0.2}, {0.1, 0.1}}, single.B = Matrix{{0.2}, {0.1}};
  EXPECT_LE((of_two.jvp(alike).x - of_one.jvp(single).x).cwiseAbs().maxCoeff(), 1e-8);
  const auto why = [&](const DataChange& c) { return refusal([&] { of_two.jvp(c); }); };
  DataChange other;
  other.B = Matrix{{0.2, 0.1}, {0, 0}};
  EXPECT_NE(why(other).find("not unique"), std::string::npos) << why(other);
  other = {};
  other.M = Matrix{{0.1, 0}, {0, 0}};
  EXPECT_NE(why(other).find("not unique"), std::string::npos) << why(other);
  SolutionChange of;
  of.x = RowMatrix::Ones(21, 2);
  const DataChange gradient = of_two.vjp(of);
  EXPECT_EQ(gradient.B.size() + gradient.N.size() + gradient.M.size(), 0);
  EXPECT_LE((gradient.A - of_one.vjp(of).A).cwiseAbs().maxCoeff(), 1e-8 * gradient.A.cwiseAbs().maxCoeff());
}

// The time of a touch is known to the root of the tolerance.
TEST(SwitchedDerivative, SeesATouchBetweenSamples) {
  const Verdict v = verdict_of(801072);
  EXPECT_FALSE(v.given);
  EXPECT_NE(v.what.find("y_0 = w_0 = 0 at t = 0.1449"), std::string::npos) << v.what;
}

// E^{-1} B = (-1/10, 1/2): the contact force pulls the position into the floor, and after the first contact no y >= 0
// holds it. With N E^{-1} B = 0 there is a solution.
TEST(SwitchedDerivative, AContactForceThatPullsHasNoSolution) {
  Scene s = ball(0.3, 0);
  const DenseDynamics d = *s.dynamics->small_state();
  const auto with = [&](const Matrix& E) {
    DenseDynamics other = d;
    other.E = E;
    s.dynamics = other;
    return s;
  };
  const Vector t = Vector::LinSpaced(5, 0, 2);
  const std::string why = refusal([&] { SwitchedDerivative(with(Matrix{{1, 0.2}, {0, 2}}), t); });
  EXPECT_NE(why.find("no active set was found that continues"), std::string::npos) << why;
  EXPECT_EQ(refusal([&] { SwitchedDerivative(with(Matrix{{1, 0}, {0.2, 2}}), t); }), "nothing was refused");
}

// The seeds of a test on random scenes.
struct Seeds {
  const char* given = std::getenv("BROMWICH_RANDOM_SCENES");
  const char* from = std::getenv("BROMWICH_FIRST_SCENE");
  long first, scenes = given ? std::atol(given) : 120;

  explicit Seeds(long without) : first(from ? std::atol(from) : without) {}
  long end() const { return first + scenes; }
};

// Of scenes that have no derivative along all changes: the one along a change of A and f is right, or refused.
TEST(SwitchedDerivative, AlongSomeChangesAgreesWithDifferencesOfTheOracle) {
  const Seeds seeds(30000);
  long taken = 0, judged = 0;
  for (long seed = seeds.first; seed < seeds.end(); ++seed) {
    if (verdict_of(std::uint32_t(seed)).given) continue;
    const Verdict v = verdict_of(std::uint32_t(seed), true);
    EXPECT_TRUE(v.good) << seed << ": " << v.what;
    taken += v.given;
    judged += v.judged;
  }
  if (!seeds.from) EXPECT_GT(judged, 0);
  if (seeds.given) std::printf("%ld scenes: %ld taken, %ld judged\n", seeds.scenes, taken, judged);
}

TEST(SwitchedDerivative, AgreesWithDifferencesOfTheOracleOrSaysThatThereIsNone) {
  const Seeds seeds(20000);
  long judged = 0, refused = 0;
  for (long seed = seeds.first; seed < seeds.end(); ++seed) {
    const Verdict v = verdict_of(std::uint32_t(seed));
    EXPECT_TRUE(v.good) << seed << ": " << v.what;
    judged += v.judged;
    refused += !v.given;
    if (seeds.given && !v.given) std::printf("%ld %s\n", seed, v.what.c_str());
  }
  EXPECT_GE(2 * judged, seeds.scenes) << refused << " refused";
  if (seeds.given) std::printf("%ld scenes: %ld judged, %ld refused\n", seeds.scenes, judged, refused);
}

}  // namespace
}  // namespace bromwich::switched_test

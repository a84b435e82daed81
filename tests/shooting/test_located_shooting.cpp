// Boundary values by shooting on located events, against closed forms and mode by mode solutions.

#include "core/shooting/located_shooting.hpp"

#include "catalogue/catalogue.hpp"
#include "core/shooting/flow_derivative.hpp"
#include "core/solve/dense_output.hpp"
#include "core/solve/shooting_control.hpp"
#include "core/solve/switch_errors.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <unsupported/Eigen/MatrixFunctions>

namespace bromwich {
namespace {

using reference::pi;

// Integrations with a tolerance of 1e-10 and their x(0): a decade of margin for the magnification by (E0 + ET D)^{-1},
// at most ten in these scenes.
constexpr double close = 1e-9;

std::unique_ptr<Backend> backend_of_one_thread() { return make_cpu_backend(1); }

Scene periodic(const DenseDynamics& d, const Matrix& M, double T) {
  Scene scene;
  const Index m = d.A.rows();
  scene.dynamics = d;
  scene.M = M;
  scene.boundary = BoundaryCondition{Matrix::Identity(m, m), -Matrix::Identity(m, m), Vector::Zero(m)};
  scene.T = T;
  scene.default_steps = 100;
  scene.breakpoints_are_all = true;
  return scene;
}

/// One state, one constraint: x' = a x + y + f, w = x + M y + g.
Scene one_state(double a, double M, const std::function<double(double)>& f, const std::function<double(double)>& g) {
  Scene scene = periodic({Matrix{{a}}, Matrix{{1}}, Matrix{{1}}}, Matrix{{M}}, 1);
  scene.f = [f](double t, Eigen::Ref<Vector> v) { v[0] = f(t); };
  scene.g = [g](double t, Eigen::Ref<Vector> v) { v[0] = g(t); };
  return scene;
}

Result shot(const Scene& scene, Options options = {}) {
  options.method = Method::shooting;
  options.states = StateSelection::all;
  return solve(scene, *backend_of_one_thread(), options);
}

/// x' = A x + b after a time.
struct Affine {
  Matrix A;
  Vector b;

  Matrix map(double t) const {
    Matrix all = Matrix::Zero(A.rows() + 1, A.rows() + 1);
    all.topLeftCorner(A.rows(), A.rows()) = t * A;
    all.topRightCorner(A.rows(), 1) = t * b;
    return all.exp();
  }
};

/// A boost converter with an ideal coil and switch, closed on [0, duty T): x = (i, v), y = (i_d, p, q).
struct Boost {
  double Vin = 5, L = 1e-4, C = 1e-4, R = 10, T = 1e-5, duty = 0.5;

  Scene scene() const {
    const Matrix A{{0, 0}, {0, -1 / (R * C)}}, B{{0, -1 / L, 1 / L}, {1 / C, 0, 0}}, N{{0, 1}, {-1, 0}, {1, 0}};
    Scene s = periodic({A, B, N}, Matrix{{0, -1, 1}, {1, 0, 0}, {-1, 0, 0}}, T);
    s.lcp_class = LcpClass::PSD;
    s.f = [v = Vin / L](double, Eigen::Ref<Vector> f) { f << v, 0; };
    s.g = [end = duty * T](double t, Eigen::Ref<Vector> g) { g << 0, t < end ? 100.0 : 0.0, 0; };
    s.breakpoints = {duty * T};
    return s;
  }
  Affine closed() const { return {Matrix{{0, 0}, {0, -1 / (R * C)}}, Vector{{Vin / L, 0}}}; }
  Affine open() const { return {Matrix{{0, -1 / L}, {1 / C, -1 / (R * C)}}, Vector{{Vin / L, 0}}}; }
};

TEST(LocatedShooting, FindsThePeriodicStateOfAConverterWithAnIdealCoil) {
  const Boost boost;
  const Matrix map = boost.open().map((1 - boost.duty) * boost.T) * boost.closed().map(boost.duty * boost.T);
  const Matrix D = map.topLeftCorner(2, 2);
  const Vector start = (Matrix::Identity(2, 2) - D).partialPivLu().solve(map.col(2).head(2));
  const Result r = shot(boost.scene());
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.method, Method::shooting);
  EXPECT_LT((r.x.row(0).transpose() - start).norm(), close * start.norm());
  EXPECT_LT((r.start - start).norm(), close * start.norm());
  EXPECT_LT(*r.boundary_residual, close * start.norm());
  ASSERT_EQ(r.multipliers.size(), 2u);
  EXPECT_NEAR(std::abs(r.multipliers[0]), std::sqrt(D.determinant()), close) << "a pair of complex ones";
  EXPECT_NEAR(2 * r.multipliers[0].real(), D.trace(), close);
}

TEST(LocatedShooting, IsWhatAutomaticTakesAlsoToATolerance) {
  const Scene scene = Boost().scene();
  Options options;
  options.states = StateSelection::all;
  const Result one = solve(scene, *backend_of_one_thread(), options);
  options.tolerance = 1e-6;
  const Result r = solve(scene, *backend_of_one_thread(), options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(one.method, Method::shooting);
  EXPECT_EQ(r.method, Method::shooting);
  EXPECT_LT(*r.error_estimate, 1e-6);
  EXPECT_LT((r.x.row(0) - one.x.row(0)).norm(), 1e-8 * one.x.row(0).norm());
}

// The current ends before the period: i(0) = 0, and v(0) is the root of v after a period minus v.
TEST(LocatedShooting, FindsThePeriodicStateInDiscontinuousConduction) {
  Boost boost;
  boost.L = 5e-6, boost.R = 100;
  const Affine held{Matrix{{0, 0}, {0, -1 / (boost.R * boost.C)}}, Vector::Zero(2)};
  const auto after = [&](double v) {
    const Vector top = boost.closed().map(boost.duty * boost.T) * Vector{{0, v, 1}};
    const double rest = (1 - boost.duty) * boost.T;
    double low = 0, high = rest;
    for (int k = 0; k < 60; ++k) {
      const double middle = (low + high) / 2;
      ((boost.open().map(middle) * top)[0] > 0 ? low : high) = middle;
    }
    return (held.map(rest - low) * (boost.open().map(low) * top))[1];
  };
  double low = 10, high = 40;
  for (int k = 0; k < 60; ++k) {
    const double middle = (low + high) / 2;
    (after(middle) > middle ? low : high) = middle;
  }
  const Result r = shot(boost.scene());
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NEAR(r.x(0, 0), 0, close);
  // The multiplier is 1 - 2e-3: a defect of rounding, 1e-13, becomes 1e-10.
  EXPECT_NEAR(r.x(0, 1), low, close * low);
  EXPECT_NEAR(std::abs(r.multipliers[1]), 0, close) << "nothing is left of the current";
  const double h = 1e-4;
  EXPECT_NEAR(r.multipliers[0].real(), (after(low + h) - after(low - h)) / (2 * h), 1e-7)
      << "h^2 of the third derivative";
}

// A tank behind a check valve: its level is integrated (A = 0), y is the flow that keeps it at zero. f = 2 pi cos(2 pi
// t) - c is positive from t = -acos(c / 2 pi) / 2 pi on, and the level rises from zero there.
TEST(LocatedShooting, TakesAZeroModeThatAConstraintFixes) {
  const double c = 1, from = -std::acos(c / (2 * pi)) / (2 * pi);
  const Scene scene = one_state(
      0, 0, [=](double t) { return 2 * pi * std::cos(2 * pi * t) - c; }, [](double) { return 0.0; });
  const Result r = shot(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NEAR(r.x(0, 0), -std::sin(2 * pi * from) + c * from, close);
  EXPECT_NEAR(std::abs(r.multipliers[0]), 0, close);
  const std::vector<Switch> switches = switches_with_errors(scene, *backend_of_one_thread(), {}, r);
  ASSERT_EQ(switches.size(), 2u);
  EXPECT_NEAR(switches[1].t, 1 + from, close);
  EXPECT_NEAR(at_times(scene, *backend_of_one_thread(), r, {0.123}).x(0, 0),
              std::sin(2 * pi * 0.123) - std::sin(2 * pi * from) - c * (0.123 - from), close);
}

// x' = 80 x + y + f at an obstacle x >= -s: held throughout, x = -s. A free solution beside it is off by e^80
// roundings.
TEST(LocatedShooting, HoldsAnUnstableStateAtItsObstacle) {
  const Scene scene = one_state(
      80, 0, [](double) { return -100.0; }, [](double t) { return 0.2 * std::sin(2 * pi * t); });
  const Result r = shot(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  for (Index j = 0; j <= r.steps; ++j) EXPECT_NEAR(r.x(j, 0), -0.2 * std::sin(2 * pi * r.t[j]), close);
  EXPECT_NEAR(r.y(25, 0), 80 * 0.2 + 100, 1e-7) << "80 times the error of x";
}

// x' = 3 x + sin(2 pi t), without contact: a multiplier of e^3.
TEST(LocatedShooting, FindsAnUnstablePeriodicState) {
  const Scene scene = one_state(
      3, 0, [](double t) { return std::sin(2 * pi * t); }, [](double) { return 1.0; });
  const Result r = shot(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NEAR(r.x(0, 0), -2 * pi / (9 + 4 * pi * pi), close);
  EXPECT_NEAR(r.multipliers[0].real(), std::exp(3), 1e-7);
}

// A buck converter whose switch closes when a ramp exceeds the amplified error of v (Deane & Hamill, IEEE Trans. Power
// Electron. 5, 1990). With 26 V its state of one period has doubled: a multiplier below -1, which no transient finds.
// The map of a period is that of two affine parts, with the time between them by bisection.
TEST(LocatedShooting, FindsTheUnstableStateOfAControlledConverter) {
  constexpr double Vin = 26, L = 20e-3, C = 47e-6, R = 22, gain = 8.4, aim = 11.3, low = 3.8, high = 8.2, T = 4e-4;
  const Matrix A{{0, -1 / L}, {1 / C, -1 / (R * C)}};
  const auto ramp = [=](double t) { return low + (high - low) * t / T; };
  Scene scene = periodic({A, Matrix{{Vin / L, 0}, {0, 0}}, Matrix{{0, gain}, {0, 0}}}, Matrix{{0, 1}, {-1, 0}}, T);
  scene.lcp_class = LcpClass::PSD;
  scene.g = [=](double t, Eigen::Ref<Vector> g) { g << -gain * aim - ramp(t), 1; };
  const Affine off{A, Vector::Zero(2)}, on{A, Vector{{Vin / L, 0}}};
  const auto map = [&](const Vector& x) {
    Vector z(3);
    z << x, 1;
    double from = 0, to = T;
    for (int k = 0; k < 60; ++k) {
      const double middle = (from + to) / 2;
      (gain * ((off.map(middle) * z)[1] - aim) > ramp(middle) ? from : to) = middle;
    }
    return Vector((on.map(T - from) * (off.map(from) * z)).head(2));
  };
  const Result r = shot(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  const Vector x = r.x.row(0).transpose();
  EXPECT_LT((map(x) - x).norm(), 10 * close * x.norm());
  Matrix D(2, 2);
  const double h = 1e-5;
  for (Index j = 0; j < 2; ++j)
    D.col(j) = (map(x + h * Vector::Unit(2, j)) - map(x - h * Vector::Unit(2, j))) / (2 * h);
  EXPECT_NEAR((r.multipliers[0] + r.multipliers[1]).real(), D.trace(), 1e-6) << "h^2 of the third derivative";
  EXPECT_LT(r.multipliers[0].real(), -1);
}

// Half a period with x(T) = -x(0) is the periodic solution of a scene that is odd under a shift by T.
TEST(LocatedShooting, TakesAntiPeriodicConditions) {
  Scene scene = periodic({Matrix{{-1}}, Matrix{{1, -1}}, Matrix{{1}, {-1}}}, Matrix::Zero(2, 2), 2);
  scene.f = [](double t, Eigen::Ref<Vector> v) { v[0] = std::sin(pi * t); };
  scene.g = [](double, Eigen::Ref<Vector> v) { v.setConstant(0.2); };
  const Result whole = shot(scene);
  scene.T = 1;
  scene.boundary->ET = Matrix{{1}};
  const Result half = shot(scene);
  ASSERT_EQ(whole.status, Status::solved) << whole.reason;
  ASSERT_EQ(half.status, Status::solved) << half.reason;
  EXPECT_NEAR(half.x(0, 0), whole.x(0, 0), close);
  EXPECT_TRUE(half.multipliers.empty());
}

TEST(LocatedShooting, TakesConditionsAtBothEnds) {
  const Scene scene = make_scene("lq-control");
  const Result r = shot(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  Vector x(scene.states()), y(scene.constraints());
  for (Index j = 0; j <= r.steps; ++j) {
    scene.exact(r.t[j], x, y);
    EXPECT_LT((r.x.row(j).transpose() - x).norm(), 10 * close);  // its states are of size 10
  }
}

// A tank behind a check valve, and beside it one that nothing fills or empties.
TEST(LocatedShooting, SaysThatOtherStatesArePeriodicToo) {
  Scene scene = periodic({Matrix::Zero(2, 2), Matrix{{1}, {0}}, Matrix{{1, 0}}}, Matrix{{0}}, 1);
  scene.f = [](double t, Eigen::Ref<Vector> v) { v << 2 * pi * std::cos(2 * pi * t) - 1, 0; };
  const Result r = shot(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NE(r.warning.find("singular"), std::string::npos) << r.warning;
  EXPECT_FALSE(r.well_posed);
}

TEST(LocatedShooting, SaysThatNothingDeterminesTheState) {
  // A capacitor behind a diode, without a load: every voltage above the peak of the source stays.
  const Result peak = shot(one_state(
      0, 1, [](double) { return 0.0; }, [](double t) { return -std::sin(2 * pi * t); }));
  ASSERT_EQ(peak.status, Status::solved) << peak.reason;
  EXPECT_FALSE(peak.well_posed);
  EXPECT_GE(peak.x(0, 0), 1 - close);
  const Scene scene =  // x = t, and no constraint is ever active
      one_state(
          0, 1, [](double) { return 1.0; }, [](double) { return 1.0; });
  EXPECT_NE(refusal([&] { shot(scene); }).find("boundary: E0 + ET e^{TA} is singular"), std::string::npos);
}

// x' = 1 - cos(2 pi t) - y, w = c - x: x rises by 1 a period, up to c, a thousand periods away. There y balances the
// rest: x(0) = c, since x' >= 0 without y.
TEST(LocatedShooting, ReachesAConstraintManyPeriodsAway) {
  Scene scene = one_state(0, 0, [](double t) { return 1 - std::cos(2 * pi * t); }, {});
  scene.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{-1}}, Matrix{{-1}}};
  scene.g = [](double, Eigen::Ref<Vector> v) { v[0] = 1000; };
  const Result r = shot(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NEAR(r.x(0, 0), 1000, 1000 * close);
  // Without the constraint nothing ends the rise.
  scene.g = [](double, Eigen::Ref<Vector> v) { v[0] = 1e12; };
  EXPECT_NE(shoot_on_events(scene, LcpClass::unknown, {}, {}).reason.find("the state drifts"), std::string::npos);
}

// A rise of 1 a period up to c, as the input of a slow mode and of a fast one that rings: z'' + 4 z' + 1e4 z = 1e4 x.
// There x = z = s = c, at rest.
TEST(LocatedShooting, ReachesItBesideSlowAndFastModes) {
  const double c = 30000;
  DenseDynamics d{Matrix::Zero(4, 4), Matrix{{-1}, {0}, {0}, {0}}, Matrix{{-1, 0, 0, 0}}};
  d.A.row(1) << 0.01, -0.01, 0, 0;
  d.A.row(2) << 0, 0, 0, 1;
  d.A.row(3) << 1e4, 0, -1e4, -4;
  Scene scene = periodic(d, Matrix{{0}}, 1);
  scene.f = [](double t, Eigen::Ref<Vector> v) { v << 1 + 0.5 * std::cos(2 * pi * t), 0, 0, 0; };
  scene.g = [c](double, Eigen::Ref<Vector> v) { v[0] = c; };
  const Result r = shot(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  for (Index i = 0; i < 3; ++i) EXPECT_NEAR(r.x(0, i), c, c * close) << i;
}

// A body on a spring under a force F + a sin(2 pi t), and friction of at most 1: x = (place, speed), y = (friction + 1,
// the speed where it is negative), w = (speed + y2, 2 - y1).
Scene rubbing_body(double F, double a) {
  Scene scene =
      periodic({Matrix{{0, 1}, {-1, 0}}, Matrix{{0, 0}, {1, 0}}, Matrix{{0, 1}, {0, 0}}}, Matrix{{0, 1}, {-1, 0}}, 1);
  scene.f = [F, a](double t, Eigen::Ref<Vector> v) { v << 0, F - 1 + a * std::sin(2 * pi * t); };
  scene.g = [](double, Eigen::Ref<Vector> v) { v << 0, 2; };
  return scene;
}

// From rest the body creeps towards F + a - 1, where the spring takes what friction does not, and stays from there on.
TEST(LocatedShooting, PassesTheBorderOfStatesThatFrictionHolds) {
  const double F = 1.2, a = 0.3;
  const Result r = shot(rubbing_body(F, a));
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_FALSE(r.well_posed) << "others stay too";
  EXPECT_GE(r.x(0, 0), F + a - 1 - close);
  EXPECT_LE(r.x(0, 0), F - a + 1 + close);
  EXPECT_LT((r.x.col(0).array() - r.x(0, 0)).abs().maxCoeff(), close) << "it does not move";
  EXPECT_LT(r.x.col(1).cwiseAbs().maxCoeff(), close);
  EXPECT_LE(shoot_on_events(rubbing_body(F, a), LcpClass::unknown, {}, {}).flows, 12)
      << "beside it F falls by four with each step of Newton's method";
}

TEST(LocatedShooting, SaysWhatWasTriedWhereNothingIsPeriodic) {
  // Pushed off its stop once a period, x grows by e^80 and comes never back.
  const Scene scene = one_state(
      80, 0, [](double t) { return -1 + 2 * std::sin(2 * pi * t); }, [](double) { return 0.0; });
  const Result r = shot(scene);
  EXPECT_EQ(r.status, Status::tolerance_not_met);
  EXPECT_NE(r.reason.find("x(0)"), std::string::npos) << r.reason;
}

TEST(LocatedShooting, InitialValuesTakeStepsAndNotLocatedEvents) {
  // x' = -x + y + 1, 0 <= y, x >= 0, from 0: x = 1 - e^{-t}.
  Scene scene = one_state(
      -1, 1, [](double) { return 1.0; }, [](double) { return 0.0; });
  scene.boundary.reset();
  scene.x0 = Vector::Zero(1);
  const Result r = shot(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.method, Method::shooting);
  EXPECT_EQ(r.start.size(), 0);
  EXPECT_NE(r.kernel.find("chunks of time"), std::string::npos) << r.kernel;
  // A step of e^{hA} is exact for constant f: rounding of 100 steps.
  EXPECT_NEAR(r.x(100, 0), 1 - std::exp(-1), 1e-13);
}

// x' = -x + y above 1 - 1.5 mod(t, 1/2), which jumps up to 1 at T too: x = e^{-t} from each jump on. The first row at a
// jump is that before it.
TEST(LocatedShooting, ASourceMayJumpAtTheEnd) {
  Scene scene = one_state(
      -1, 0, [](double) { return 0.0; }, [](double t) { return -1 + 1.5 * std::fmod(t, 0.5); });
  scene.boundary.reset();
  scene.x0 = Vector::Ones(1);
  scene.T = 2;
  scene.breakpoints = {0.5, 1, 1.5, 2};
  Options options;
  options.tolerance = 1e-4;
  const Result r = shot(scene, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  for (Index j = 0; j < r.t.size(); ++j) {
    const double since = std::fmod(r.t[j], 0.5);
    if (since > 1e-3 && since < 0.5 - 1e-3) EXPECT_NEAR(r.x(j, 0), std::exp(-since), 2e-4) << r.t[j];
  }
}

// A mass that lands on a rigid floor at a time that depends on its start, and is pushed off again.
TEST(FlowDerivative, AgreesWithDifferencesThroughImpacts) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {0, -0.1}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  scene.M = Matrix{{0}};
  scene.f = [](double t, Eigen::Ref<Vector> v) { v << 0, -1 + 2 * std::sin(t); };
  scene.T = 7;
  const auto flow = [&](const Vector& x0) {
    scene.x0 = x0;
    EventOptions options;
    options.tolerance = 1e-12;
    return integrate_with_events(scene, LcpClass::PSD, {}, options);
  };
  const Vector x0{{0.3, 0.2}};
  const EventSolution s = flow(x0);
  ASSERT_TRUE(s.complete) << s.reason;
  ASSERT_GE(s.jumps, 1);
  const Matrix D = FlowDerivative(scene).at_end(s);
  const double h = 1e-5;
  for (Index j = 0; j < 2; ++j) {
    const Vector dx = h * Vector::Unit(2, j);
    const Vector differences = (flow(x0 + dx).x(7, true) - flow(x0 - dx).x(7, true)) / (2 * h);
    EXPECT_LT((D.col(j) - differences).norm(), 1e-6) << "h^2, and integrations of 1e-12 over h";
  }
}

}  // namespace
}  // namespace bromwich

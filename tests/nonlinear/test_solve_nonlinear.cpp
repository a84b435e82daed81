// Nonlinear complementarity systems against linear scenes, exact solutions and Runge-Kutta references.

#include "nonlinear/solve_nonlinear.hpp"

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/result/slack.hpp"
#include "core/result/switching.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "nonlinear/nonlinear_output.hpp"
#include "tests/nonlinear/cubic_stop.hpp"
#include "tests/nonlinear/nonlinear_scenes.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

namespace bromwich {
namespace {

TEST(SolveNonlinear, LinearScenesAreSolvedAsTheirEngineDoes) {
  const auto backend = make_cpu_backend();
  NonlinearScene s;
  s.linear = make_scene("dlcp-small", {});
  Options options;
  options.method = Method::march;
  options.states = StateSelection::all;
  options.steps = 100;
  const Result linear = solve(s.linear, *backend, options);
  for (const NonlinearMethod m : {NonlinearMethod::march, NonlinearMethod::iteration, NonlinearMethod::newton}) {
    const NonlinearResult r = solved_by(s, m, 100);
    EXPECT_LE((r.x - linear.x).cwiseAbs().maxCoeff(), 1e-12 * linear.x.cwiseAbs().maxCoeff()) << to_string(m);
    EXPECT_LE((r.y - linear.y).cwiseAbs().maxCoeff(), 1e-12 * linear.y.cwiseAbs().maxCoeff()) << to_string(m);
    NonlinearScene with_zero = s;  // which is not known to be zero
    with_zero.phi = [](double, In, In, Eigen::Ref<Vector> v) { v.setZero(); };
    const NonlinearResult same = solved_by(with_zero, m, 100);
    EXPECT_LE((same.x - linear.x).cwiseAbs().maxCoeff(), 1e-12 * linear.x.cwiseAbs().maxCoeff()) << to_string(m);
    EXPECT_LE((same.y - linear.y).cwiseAbs().maxCoeff(), 1e-12 * linear.y.cwiseAbs().maxCoeff()) << to_string(m);
    EXPECT_EQ(same.solves, 1) << "one linear solve, and phi at its time points";
    with_zero.phi = [](double, In x, In, Eigen::Ref<Vector> v) { v = 1e-9 * x; };  // 0 for x0 = 0 and not elsewhere
    EXPECT_GT(solved_by(with_zero, m, 100).newton + solved_by(with_zero, m, 100).solves, 1) << to_string(m);
  }
}

// x' = -x + y, w = x + y - g with a pulse g: y = max(0, g - x). Between its edges x' = -x or x' = -2 x + g.
NonlinearScene pulsed() {
  NonlinearScene s;
  s.linear.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  s.linear.M = Matrix{{1}};
  s.linear.g = [](double t, Eigen::Ref<Vector> v) { v[0] = t >= 0.3 && t < 0.75 ? -2 : 0; };
  s.linear.breakpoints = {0.3, 0.75};
  s.linear.breakpoints_are_all = true;
  s.linear.x0 = Vector{{0.5}};
  s.linear.T = 1;
  s.phi = [](double, In, In, Eigen::Ref<Vector> v) { v.setZero(); };
  return s;
}

TEST(SolveNonlinear, DividesStepsWhereSourcesJump) {
  const double up = 0.5 * std::exp(-0.3), top = 1 + (up - 1) * std::exp(-0.9), end = top * std::exp(-0.25);
  for (const NonlinearMethod m : {NonlinearMethod::march, NonlinearMethod::iteration, NonlinearMethod::newton}) {
    for (const Index J : {50, 80}) {  // the edges inside steps and on time points
      const NonlinearResult r = solved_by(pulsed(), m, J);
      const double h = 1.0 / double(J);
      EXPECT_NEAR(r.x(J, 0), end, h * h) << to_string(m) << " " << J;  // of first order it would err by h
      EXPECT_LE(r.residual, 1e-10) << to_string(m) << " " << J;
    }
  }
}

// A rectangle of grid points with a reaction on the side, w = N x + M y + g + y^3/50: as dense matrices by marching,
// and as a Kronecker sum by the iteration on the trace.
TEST(SolveNonlinear, LargeScenesByTheTrace) {
  NonlinearScene large;
  large.linear = make_scene("signorini", {{"Q", 7}});
  large.linear.default_steps = 60;
  large.of_trace = true;
  large.gamma = [](double, In, In y, Eigen::Ref<Vector> v) { v = 0.02 * y.array().cube(); };
  large.phi = [](double t, In v, In y, Eigen::Ref<Vector> value) { value = 0.1 * (std::sin(t) * y + 0.01 * v); };
  NonlinearScene dense = large;
  dense.linear = written_out(dense.linear);  // small Kronecker sums stay as they are, small sparse matrices do not
  const auto backend = make_cpu_backend();
  const NonlinearResult a = solve_nonlinear(large, *backend), b = solve_nonlinear(dense, *backend);
  ASSERT_EQ(a.status, Status::solved) << a.reason;
  ASSERT_EQ(b.status, Status::solved) << b.reason;
  EXPECT_EQ(a.method, NonlinearMethod::iteration);
  EXPECT_EQ(b.method, NonlinearMethod::march);
  EXPECT_EQ(a.x.size(), 0);
  const double size = b.y.cwiseAbs().maxCoeff();
  EXPECT_LE((a.y - b.y).bottomRows(60).cwiseAbs().maxCoeff(), 1e-9 * size);  // kernels to 1e-12, sums of 60 steps
  EXPECT_LE(a.residual, 1e-10);
  for (const NonlinearMethod m : {NonlinearMethod::newton, NonlinearMethod::march}) {
    const NonlinearResult c = solved_by(large, m, 60);
    EXPECT_LE((c.y - b.y).bottomRows(60).cwiseAbs().maxCoeff(), 1e-9 * size) << to_string(m);
    EXPECT_EQ(c.marched, m == NonlinearMethod::march ? 60 : 0);
    EXPECT_GT(c.newton, 0);
  }
  NonlinearOptions pointwise;
  pointwise.method = NonlinearMethod::pointwise;
  EXPECT_EQ(solve_nonlinear(large, *backend, pointwise).status, Status::unsupported);
}

// The threads of the host divide rows alone: nothing is summed in another order.
TEST(SolveNonlinear, LargeScenesOnSeveralThreads) {
  NonlinearScene large;
  large.linear = make_scene("signorini", {{"Q", 7}});
  large.of_trace = true;
  large.gamma = [](double, In, In y, Eigen::Ref<Vector> v) { v = 0.02 * y.array().cube(); };
  const auto backend = make_cpu_backend(3);
  for (const NonlinearMethod m : {NonlinearMethod::iteration, NonlinearMethod::newton}) {
    NonlinearOptions options;
    options.method = m;
    options.steps = 60;
    const NonlinearResult one = solve_nonlinear(large, *backend, options);
    options.concurrent = true;
    const NonlinearResult several = solve_nonlinear(large, *backend, options);
    ASSERT_EQ(several.status, Status::solved) << several.reason;
    EXPECT_EQ(one.solves, several.solves);
    EXPECT_EQ(one.y, several.y);
    EXPECT_EQ(one.w, several.w);
  }
}

TEST(SolveNonlinear, LargeScenesWithoutARestAreOneLinearSolve) {
  NonlinearScene large;
  large.linear = make_scene("signorini", {{"Q", 7}});
  large.of_trace = true;
  large.gamma = [](double, In, In y, Eigen::Ref<Vector> v) { v = (y.array() < -1).cast<double>(); };
  const NonlinearResult r = solved_by(large, NonlinearMethod::iteration, 60);
  EXPECT_EQ(r.solves, 1);
  Options options;
  options.steps = 60;
  const auto backend = make_cpu_backend();
  const Result linear = solve(large.linear, *backend, options);
  EXPECT_LE((r.y - linear.y).cwiseAbs().maxCoeff(), 1e-12 * linear.y.cwiseAbs().maxCoeff());
}

TEST(SolveNonlinear, TakesSourcesThroughB) {
  NonlinearScene s = cubic_stop(), through = s;
  through.linear.f_entry = SourceEntry::through_B;  // B = (0, 1)
  through.linear.f = [](double t, Eigen::Ref<Vector> v) { v[0] = 2 * std::cos(2 * t); };
  for (const NonlinearMethod m : {NonlinearMethod::march, NonlinearMethod::iteration})
    EXPECT_LE((solved_by(through, m, 100).x - solved_by(s, m, 100).x).cwiseAbs().maxCoeff(), 1e-13) << to_string(m);
}

TEST(SolveNonlinear, HasOrderTwo) {
  const NonlinearScene s = cubic_stop();
  const auto y_of = [](double, const Vector& x) { return Vector{{std::max(0.0, -5 * (x[0] + 0.5))}}; };
  const Vector reference = by_runge_kutta(s, y_of, 200000);  // a kink of y costs h^2 at most: 1e-9
  double first = 0;
  for (const Index J : {200, 400, 800}) {
    const NonlinearResult r = solved_by(s, NonlinearMethod::march, J);
    const double error = (r.x.row(J).transpose() - reference).cwiseAbs().maxCoeff();
    if (J == 200) first = error;
    if (J == 800) {
      EXPECT_NEAR(std::log2(first / error) / 2, 2, 0.2);  // the switches fall into steps anywhere
    }
    EXPECT_LE(r.residual, 1e-12);
    EXPECT_LE(r.defect, 1e-12);
  }
}

TEST(SolveNonlinear, IterationAndNewtonAgreeWithMarching) {
  NonlinearScene s = cubic_stop();
  const NonlinearResult march = solved_by(s, NonlinearMethod::march, 300);
  for (const NonlinearMethod m : {NonlinearMethod::iteration, NonlinearMethod::newton}) {
    const NonlinearResult r = solved_by(s, m, 300);
    EXPECT_LE((r.x - march.x).cwiseAbs().maxCoeff(), 1e-10) << to_string(m);  // tolerance / (1 - contraction)
    EXPECT_LE((r.y - march.y).cwiseAbs().maxCoeff(), 1e-9) << to_string(m);   // 1/M times that
    EXPECT_LE(r.residual, 1e-10);
    EXPECT_LE(r.defect, 1e-10);
    EXPECT_GT(r.windows, 0);
    EXPECT_GT(r.solves, 1);
  }
  s.dphi = {};  // by central differences
  EXPECT_LE((solved_by(s, NonlinearMethod::march, 300).x - march.x).cwiseAbs().maxCoeff(), 1e-10);
}

// A diode by Shockley's law charges a capacitor: C v' = -v / R + y, 0 <= y, w = v - 5 sin 2t + r y + V ln(1 + y / I).
TEST(SolveNonlinear, ShockleysLawInTheSlack) {
  constexpr double r = 0.5, V = 0.026, I = 1e-6;
  NonlinearScene s;
  s.linear.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{2}}, Matrix{{1}}};
  s.linear.M = Matrix{{r}};
  s.linear.g = [](double t, Eigen::Ref<Vector> v) { v[0] = -5 * std::sin(2 * t); };
  s.linear.x0 = Vector{{0}};
  s.linear.T = 4;
  s.gamma = [](double, In, In y, Eigen::Ref<Vector> v) { v[0] = V * std::log1p(std::max(0.0, y[0]) / I); };
  s.dgamma = [](double, In, In y, Eigen::Ref<Matrix> by_x, Eigen::Ref<Matrix> by_y) {
    by_x.setZero();
    by_y(0, 0) = V / (I + std::max(0.0, y[0]));
  };
  const auto y_of = [](double t, const Vector& x) {
    double low = 0, high = 100;  // w increases with y
    const double fixed = x[0] - 5 * std::sin(2 * t);
    if (fixed >= 0) return Vector{{0.0}};
    for (int k = 0; k < 60; ++k) {
      const double y = (low + high) / 2;
      (fixed + r * y + V * std::log1p(y / I) > 0 ? high : low) = y;
    }
    return Vector{{low}};
  };
  const Vector reference = by_runge_kutta(s, y_of, 20000);
  const NonlinearResult a = solved_by(s, NonlinearMethod::march, 400), b = solved_by(s, NonlinearMethod::march, 800);
  const double first = std::abs(a.x(400, 0) - reference[0]), second = std::abs(b.x(800, 0) - reference[0]);
  EXPECT_LE(second, 2e-4);  // h^2 y''
  EXPECT_GE(first / second, 2.5) << first << " " << second;
}

TEST(SolveNonlinear, AStateThatIsStopped) {
  const NonlinearScene s = stopped();
  const NonlinearResult r = solved_by(s, NonlinearMethod::march, 400);
  EXPECT_FALSE(r.continuous);
  for (Index j = 0; j <= 400; ++j) {
    const double t = r.t[j], contact = std::atan(1.0);
    const double h = 2.0 / 400, exact = t < contact ? std::tan(contact - t) : 0;
    EXPECT_NEAR(r.x(j, 0), exact, h * h) << t;
    if (t > contact + 2 * h) {
      EXPECT_NEAR(r.y(j, 0), 1, 1e-9) << t;
    }
  }
  const auto backend = make_cpu_backend();
  NonlinearOptions options;
  options.method = NonlinearMethod::iteration;
  EXPECT_EQ(solve_nonlinear(s, *backend, options).status, Status::unsupported);
}

TEST(SolveNonlinear, HalvesStepsUntilTheErrorIsReached) {
  const NonlinearScene s = cubic_stop();
  const auto y_of = [](double, const Vector& x) { return Vector{{std::max(0.0, -5 * (x[0] + 0.5))}}; };
  const Vector reference = by_runge_kutta(s, y_of, 100000);
  const auto backend = make_cpu_backend();
  NonlinearOptions options;
  options.steps = 50;
  options.error = 1e-4;
  NonlinearResult r = solve_nonlinear(s, *backend, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  ASSERT_TRUE(r.error_estimate);
  EXPECT_LE(*r.error_estimate, 1e-4);
  const Vector error = r.x.bottomRows(1).transpose() - reference;
  EXPECT_LE(error.cwiseAbs().maxCoeff(), 3e-4 * r.x.cwiseAbs().maxCoeff());
  options.max_steps = 100;
  r = solve_nonlinear(s, *backend, options);
  EXPECT_EQ(r.status, Status::tolerance_not_met);
  EXPECT_NE(r.reason, "");
}

// x and y in units of 1e15 of what they were: the same solution.
TEST(SolveNonlinear, DoesNotDependOnUnits) {
  const NonlinearScene s = cubic_stop();
  constexpr double unit = 1e-15;
  NonlinearScene small = s;
  small.linear.f = [](double t, Eigen::Ref<Vector> v) { v << 0, unit * 2 * std::cos(2 * t); };
  small.linear.g = [](double, Eigen::Ref<Vector> v) { v[0] = unit * 0.5; };
  small.linear.x0 *= unit;
  small.phi = [](double, In x, In, Eigen::Ref<Vector> v) { v << 0, -unit * std::pow(x[0] / unit, 3); };
  small.dphi = {};
  for (const NonlinearMethod m : {NonlinearMethod::march, NonlinearMethod::iteration}) {
    const NonlinearResult r = solved_by(s, m, 200), other = solved_by(small, m, 200);
    EXPECT_LE((other.x / unit - r.x).cwiseAbs().maxCoeff(), 1e-9) << to_string(m);
    EXPECT_LE((other.y / unit - r.y).cwiseAbs().maxCoeff(), 1e-8) << to_string(m);
  }
}

// x' = -4/5 from 1, and a floor at 1/2 that is reached on a time point: y is rounding there, of any relative change.
// Behind it y = 4/5 holds the state.
TEST(SolveNonlinear, ForcesThatCancel) {
  NonlinearScene s;
  s.linear.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{1}}, Matrix{{1}}};
  s.linear.M = Matrix{{0}};
  s.linear.g = [](double, Eigen::Ref<Vector> v) { v[0] = -0.5; };
  s.linear.x0 = Vector{{1}};
  s.linear.T = 1;
  s.phi = [](double, In, In, Eigen::Ref<Vector> v) { v[0] = -0.8; };
  for (const Index J : {Index(50), Index(200), Index(800)}) {
    const NonlinearResult r = solved_by(s, NonlinearMethod::march, J);
    EXPECT_NEAR(r.x(J, 0), 0.5, 1e-12) << J;
    EXPECT_NEAR(r.y(J, 0), 0.8, 1e-9) << J;
  }
}

// gamma = sqrt(y) - 2 exists for y >= 0 alone, where it is called: y + sqrt(y) = 2 - x without derivatives.
TEST(SolveNonlinear, FunctionsAreCalledForAdmissibleY) {
  NonlinearScene s;
  s.linear.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  s.linear.M = Matrix{{1}};
  s.linear.x0 = Vector{{3}};
  s.linear.T = 2;
  double least = 0;
  s.gamma = [&least](double, In, In y, Eigen::Ref<Vector> v) {
    least = std::min(least, y[0]);
    v[0] = y[0] / (1 + std::sqrt(y[0])) - 2;
  };
  const auto y_of = [](double, const Vector& x) {
    double y = 0;
    for (int k = 0; k < 80 && x[0] < 2; ++k) y = 2 - x[0] - y / (1 + std::sqrt(y));  // contracts: |gamma'| < 1
    return Vector{{y}};
  };
  const Vector reference = by_runge_kutta(s, y_of, 20000);
  for (const NonlinearMethod m :
       {NonlinearMethod::march, NonlinearMethod::iteration, NonlinearMethod::newton, NonlinearMethod::pointwise}) {
    // h^2 of steps of 1/200 times second derivatives of size 10.
    EXPECT_NEAR(solved_by(s, m, 400).x(400, 0), reference[0], 2.5e-4) << to_string(m);
  }
  EXPECT_EQ(least, 0);
}

}  // namespace
}  // namespace bromwich

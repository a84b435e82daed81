// Values of nonlinear solutions between the time points.

#include "core/base/error.hpp"
#include "core/result/slack.hpp"
#include "core/result/switching.hpp"
#include "cpu/cpu_backend.hpp"
#include "nonlinear/nonlinear_output.hpp"
#include "nonlinear/solve_nonlinear.hpp"
#include "tests/nonlinear/cubic_stop.hpp"
#include "tests/nonlinear/nonlinear_scenes.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace bromwich {
namespace {

TEST(NonlinearRows, AtAnyTime) {
  const NonlinearScene s = cubic_stop();
  const auto y_of = [](double, const Vector& x) { return Vector{{std::max(0.0, -5 * (x[0] + 0.5))}}; };
  NonlinearScene part = s;
  part.linear.T = 4.4321;
  const Vector reference = by_runge_kutta(part, y_of, 100000);
  const auto backend = make_cpu_backend();
  double error[2];
  for (const int k : {0, 1}) {
    const NonlinearResult r = solved_by(s, NonlinearMethod::march, k ? 800 : 400);
    const NonlinearResult rows = nonlinear_at(s, *backend, r, {0, 3, 4.4321, 6});
    EXPECT_EQ(rows.x.row(0), r.x.row(0));
    EXPECT_EQ(rows.x.row(3), r.x.bottomRows(1));
    EXPECT_EQ(rows.y.row(1), r.y.row(k ? 400 : 200));
    error[k] = (rows.x.row(2).transpose() - reference).cwiseAbs().maxCoeff();
  }
  EXPECT_GE(error[0] / error[1], 2.5);  // order 2, switches fall into steps anywhere
  const NonlinearResult r = solved_by(s, NonlinearMethod::march, 400);
  const Result linear = as_result(s, r);
  EXPECT_LE((slack(s.linear, linear) - r.w).cwiseAbs().maxCoeff(), 1e-13);
  EXPECT_EQ(switches(linear).size(), 3u);  // bench/results/nonlinear-reference.json has their times
  EXPECT_NEAR(switches(linear)[0].t, 2.3, 0.5);
  EXPECT_THROW(nonlinear_at(s, *backend, r, {7}), Error);
}

// y of a diode bends where it begins to conduct, inside a step. A line through the rows errs there by h times its
// slope, and w and y of it are both positive.
TEST(NonlinearRows, FollowSwitches) {
  NonlinearScene s;
  s.linear.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{2}}, Matrix{{1}}};
  s.linear.M = Matrix{{0.5}};
  s.linear.g = [](double t, Eigen::Ref<Vector> v) { v[0] = -5 * std::sin(2 * t); };
  s.linear.x0 = Vector{{0}};
  s.linear.T = 4;
  s.phi = [](double, In x, In, Eigen::Ref<Vector> v) { v[0] = -0.1 * x[0] * x[0] * x[0]; };
  const auto backend = make_cpu_backend();
  constexpr Index J = 40, finer = 64;
  for (const NonlinearMethod m : {NonlinearMethod::march, NonlinearMethod::iteration}) {
    const NonlinearResult r = solved_by(s, m, J), fine = solved_by(s, m, J * finer);
    std::vector<double> times;
    double of_rows = 0;
    for (Index k = 0; k <= J * finer; ++k) {
      times.push_back(fine.t[k]);
      if (k % finer == 0) of_rows = std::max(of_rows, std::abs(r.y(k / finer, 0) - fine.y(k, 0)));
    }
    const NonlinearResult rows = nonlinear_at(s, *backend, r, times);
    // The step from the row before is a step of the method: its own error is no larger than that of the rows.
    EXPECT_LE((rows.y - fine.y).cwiseAbs().maxCoeff(), 2 * of_rows) << to_string(m);
    EXPECT_LE(rows.y.cwiseMin(rows.w).cwiseAbs().maxCoeff(), 1e-10) << to_string(m);
  }
}

// Where y jumps, a step of the length that is left is solved: x = tan(pi/4 - t), then 0.
TEST(NonlinearRows, WhereYJumps) {
  const NonlinearScene s = stopped();
  const auto backend = make_cpu_backend();
  const NonlinearResult r = solved_by(s, NonlinearMethod::march, 200);
  const NonlinearResult rows = nonlinear_at(s, *backend, r, {0.123, 1.777});
  EXPECT_NEAR(rows.x(0, 0), std::tan(std::atan(1.0) - 0.123), 1e-4);  // h^2
  EXPECT_NEAR(rows.x(1, 0), 0, 1e-12);
  EXPECT_NEAR(rows.y(1, 0), 1, 1e-9);
}

// x' = -x^2 + y from 2 until x = 1/2, where y = 1/4 holds it: x = 1/(t + 1/2), y acts from t = 3/2 on. On steps of
// their own lengths, at the rows and between them.
TEST(NonlinearRows, OfStepsOfTheirOwnLengths) {
  NonlinearScene s = cubic_stop();
  s.linear.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{1}}, Matrix{{1}}};
  s.linear.M = Matrix{{0}};
  s.linear.lcp_class = LcpClass::PSD;
  s.linear.f = {};
  s.linear.g = [](double, Eigen::Ref<Vector> g) { g[0] = -0.5; };
  s.linear.x0 = Vector{{2}};
  s.linear.T = 2.3;
  s.phi = [](double, In x, In, Eigen::Ref<Vector> v) { v[0] = -x[0] * x[0]; };
  s.dphi = {};
  s.gamma = {};
  s.dgamma = {};
  const auto backend = make_cpu_backend(1);
  NonlinearOptions options;
  options.steps = 16;
  for (const double tolerance : {1e-3, 1e-6}) {
    options.error = tolerance;
    const NonlinearResult r = solve_nonlinear(s, *backend, options);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_EQ(r.own_error, tolerance);
    EXPECT_LE(r.marched, 4000);
    const NonlinearResult between = nonlinear_at(s, *backend, r, {0.123, 0.777, 1.4999, 1.6, 2.3});
    for (const NonlinearResult* rows : {&r, &between})
      for (Index j = 0; j < rows->t.size(); ++j) {
        const double t = rows->t[j];
        EXPECT_NEAR(rows->x(j, 0), std::max(0.5, 1 / (t + 0.5)), 2 * tolerance) << t;
        if (std::abs(t - 1.5) > 1e-3) {
          EXPECT_NEAR(rows->y(j, 0), t < 1.5 ? 0 : 0.25, tolerance) << t;
        }
      }
    for (Index j = 0; j < r.t.size(); ++j)
      EXPECT_NEAR(r.y_integral(j, 0), 0.25 * std::max(0.0, r.t[j] - 1.5), 2.3 * tolerance) << r.t[j];
  }
}

}  // namespace
}  // namespace bromwich

// How solves of nonlinear systems end that find no solution, and options that they refuse.

#include "nonlinear/solve_nonlinear.hpp"

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/nonlinear/cubic_stop.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

namespace bromwich {
namespace {

TEST(SolveNonlinear, SaysWhereNewtonFails) {
  NonlinearScene s = cubic_stop();
  s.phi = [](double, In x, In, Eigen::Ref<Vector> v) { v << 0, 50 * x[0] * x[0]; };  // blows up
  s.dphi = {};
  const auto backend = make_cpu_backend();
  NonlinearOptions options;
  options.steps = 100;
  const NonlinearResult r = solve_nonlinear(s, *backend, options);
  EXPECT_EQ(r.status, Status::tolerance_not_met);
  EXPECT_NE(r.reason.find("t = "), std::string::npos) << r.reason;
  options.tolerance = 0;
  EXPECT_THROW(solve_nonlinear(s, *backend, options), Error);
}

TEST(SolveNonlinear, SaysWhatIsNotFiniteOrHasNoSolution) {
  const auto backend = make_cpu_backend();
  NonlinearOptions options;
  options.steps = 60;
  for (const NonlinearMethod m :
       {NonlinearMethod::march, NonlinearMethod::iteration, NonlinearMethod::newton, NonlinearMethod::pointwise}) {
    options.method = m;
    NonlinearScene s = cubic_stop();
    s.dphi = {};
    s.phi = [](double t, In x, In, Eigen::Ref<Vector> v) { v << 0, t < 3 ? x[0] : NAN; };
    NonlinearResult r = solve_nonlinear(s, *backend, options);
    EXPECT_EQ(r.status, Status::tolerance_not_met) << to_string(m);
    EXPECT_NE(r.reason.find("the step to t = 3"), std::string::npos) << r.reason;
    EXPECT_NE(r.reason.find("phi is not finite"), std::string::npos) << r.reason;
    s.phi = [](double, In, In, Eigen::Ref<Vector> v) { v << 0, NAN; };
    r = solve_nonlinear(s, *backend, options);
    EXPECT_EQ(r.status, Status::nonfinite) << to_string(m);
    s = cubic_stop();
    s.gamma = [](double, In, In, Eigen::Ref<Vector> v) { v << NAN; };
    r = solve_nonlinear(s, *backend, options);
    EXPECT_EQ(r.status, Status::nonfinite) << to_string(m);
    EXPECT_EQ(r.reason, "gamma is not finite at t = 0");
  }
  // w = -1 - x^2 whatever y is.
  NonlinearScene s = cubic_stop();
  s.linear.M = Matrix{{0}};
  s.linear.dynamics = DenseDynamics{Matrix{{0, 1}, {-1, -0.2}}, Matrix{{0}, {0}}, Matrix{{0, 0}}};
  s.gamma = [](double, In x, In, Eigen::Ref<Vector> v) { v << -2 - x[0] * x[0]; };
  options.method = NonlinearMethod::march;
  const NonlinearResult r = solve_nonlinear(s, *backend, options);
  EXPECT_EQ(r.status, Status::tolerance_not_met);
  EXPECT_NE(r.reason.find("has no solution"), std::string::npos) << r.reason;
}

// x' = x^2 from 1 ends at t = 1: finer grids come no further, and six of them are enough to say so.
TEST(SolveNonlinear, FinerGridsEndWhereNoneIsSolved) {
  NonlinearScene s = cubic_stop();
  s.linear.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{0}}, Matrix{{1}}};
  s.linear.f = {};
  s.linear.x0 = Vector{{1}};
  s.linear.T = 2;
  s.phi = [](double, In x, In, Eigen::Ref<Vector> v) { v[0] = x[0] * x[0]; };
  s.dphi = {};
  const auto backend = make_cpu_backend();
  NonlinearOptions options;
  options.steps = 20;
  options.error = 1e-3;
  const NonlinearResult r = solve_nonlinear(s, *backend, options);
  EXPECT_EQ(r.status, Status::tolerance_not_met);
  EXPECT_EQ(r.t.size(), 20 * 32 + 1);
  EXPECT_NE(r.reason.find("6 grids in turn end before T"), std::string::npos) << r.reason;
}

// x' = L x from 1 grows by e^{Lh} in a step: with Lh > 2 the step's (1 + Lh/2)/(1 - Lh/2) is negative. Two states that
// grow alike have a positive determinant.
TEST(SolveNonlinear, DoesNotTakeGrowthForDecay) {
  for (const Index m : {Index(1), Index(2), Index(65)})
    for (const double L : {150.0, 250.0, 1e4, 1e200}) {
      NonlinearScene s = cubic_stop();
      s.linear.dynamics = DenseDynamics{Matrix::Zero(m, m), Matrix::Zero(m, 1), Matrix::Ones(1, m)};
      s.linear.f = {};
      s.linear.x0 = Vector::Ones(m);
      s.linear.T = 1;
      s.phi = [L](double, In x, In, Eigen::Ref<Vector> v) { v = L * x; };
      s.dphi = [L](double, In, In, Eigen::Ref<Matrix> by_x, Eigen::Ref<Matrix> by_y) {
        by_x.setIdentity();
        by_x *= L;
        by_y.setZero();
      };
      const auto backend = make_cpu_backend();
      NonlinearOptions options;
      options.steps = 100;
      options.confirm = false;  // e^{150} of 100 steps is growth, and little else
      const NonlinearResult r = solve_nonlinear(s, *backend, options);
      EXPECT_EQ(r.status, L < 200 ? Status::solved : Status::tolerance_not_met) << m << " " << L << r.reason;
      EXPECT_EQ(r.reason.find("grow by more than e^2") != std::string::npos, L > 200) << r.reason;
    }
}

// x' = -10^6 (x - cos t) - 10^5 x^3: behind a layer that no grid here resolves x = cos t - x^3/10 up to 10^-6.
// Differences of grids are rounding there and do not fall.
TEST(SolveNonlinear, DifferencesBelowTheToleranceNeedNoOrder) {
  NonlinearScene s = cubic_stop();
  s.linear.dynamics = DenseDynamics{Matrix{{-1e6}}, Matrix{{1}}, Matrix{{1}}};
  s.linear.M = Matrix{{1}};
  s.linear.f = {};
  s.linear.g = {};
  s.linear.x0 = Vector{{1}};
  s.linear.T = 1.5;
  s.phi = [](double t, In x, In, Eigen::Ref<Vector> v) { v[0] = 1e6 * std::cos(t) - 1e5 * std::pow(x[0], 3); };
  s.dphi = {};
  const auto backend = make_cpu_backend();
  NonlinearOptions options;
  options.steps = 50;
  options.error = 1e-3;
  options.max_steps = 3200;
  const NonlinearResult r = solve_nonlinear(s, *backend, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  double x = std::cos(1.5);
  for (int k = 0; k < 60; ++k) x = std::cos(1.5) - 0.1 * std::pow(x, 3);
  EXPECT_NEAR(r.x(r.x.rows() - 1, 0), x, 1e-3);
}

TEST(SolveNonlinear, RefusesOptionsOfAnotherProblem) {
  const NonlinearScene s = cubic_stop();
  const auto backend = make_cpu_backend();
  for (const Method inner : {Method::euler, Method::events, Method::galerkin, Method::dual, Method::contour_literal}) {
    NonlinearOptions options;
    options.inner = inner;
    EXPECT_EQ(refusal([&] { solve_nonlinear(s, *backend, options); }),
              "inner: " + std::string(to_string(inner)) +
                  " has other steps than these; use auto, march, contour or multigrid");
  }
  NonlinearOptions options;
  options.error = 1e-3;
  options.steps = 100;
  options.max_steps = 50;
  EXPECT_EQ(refusal([&] { solve_nonlinear(s, *backend, options); }),
            "max_steps: found 50; give 100 or more, the steps of the first grid");
}

}  // namespace
}  // namespace bromwich

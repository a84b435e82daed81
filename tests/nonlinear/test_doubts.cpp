// Results on one grid: what is off by much is not called solved without a word. The oracle is Runge and Kutta's method
// with steps of 1e-5, in which y is a function of x.

#include "nonlinear/doubts.hpp"

#include "cpu/cpu_backend.hpp"
#include "nonlinear/solve_nonlinear.hpp"
#include "tests/nonlinear/cubic_stop.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace bromwich {
namespace {

constexpr double k = 400, T = 2;  // stiffness of the spring, time

double force_of_stop(double q, double mu) { return std::max(0.0, -(q + 0.2) / mu); }

// A driven oscillator with a cubic spring, q'' = -k q - k q^3 - 2 q' + k sin 5t + k y, against a stop with compliance
// mu, w = q + 0.2 + mu y.
NonlinearScene stop(double mu) {
  NonlinearScene s = cubic_stop();
  s.linear.dynamics = DenseDynamics{Matrix{{0, 1}, {-k, -2}}, Matrix{{0}, {k}}, Matrix{{1, 0}}};
  s.linear.M = Matrix{{mu}};
  s.linear.f = [](double t, Eigen::Ref<Vector> v) { v << 0, k * std::sin(5 * t); };
  s.linear.g = [](double, Eigen::Ref<Vector> v) { v[0] = 0.2; };
  s.linear.T = T;
  s.phi = [](double, In x, In, Eigen::Ref<Vector> v) { v << 0, -k * std::pow(x[0], 3); };
  s.dphi = {};
  return s;
}

// q at J+1 times. Steps of 1e-5 are a hundredth of the period 2 pi (mu / k)^{1/2} > 1e-3 of the stiffest contact.
Vector oracle(double mu, Index J) {
  const auto slope = [mu](double t, const Vector& x) {
    return Vector{{x[1], k * (std::sin(5 * t) - x[0] - std::pow(x[0], 3) + force_of_stop(x[0], mu)) - 2 * x[1]}};
  };
  const Index parts = 200000 / J;
  const double h = T / double(J * parts);
  Vector x{{0.3, 0}}, q(J + 1);
  q[0] = x[0];
  for (Index j = 0; j < J * parts; ++j) {
    const double t = double(j) * h;
    const Vector a = slope(t, x), b = slope(t + h / 2, x + h / 2 * a), c = slope(t + h / 2, x + h / 2 * b),
                 d = slope(t + h, x + h * c);
    x += h / 6 * (a + 2 * b + 2 * c + d);
    if ((j + 1) % parts == 0) q[(j + 1) / parts] = x[0];
  }
  return q;
}

// The largest error of q and y over their largest values, at t > 0.
double error_of(const NonlinearResult& r, double mu) {
  const Vector q = oracle(mu, r.t.size() - 1);
  double of_q = 0, of_y = 0, size_of_y = 1e-300;
  for (Index j = 1; j < q.size(); ++j) {
    const double y = force_of_stop(q[j], mu);
    of_q = std::max(of_q, std::abs(r.x(j, 0) - q[j]));
    of_y = std::max(of_y, std::abs(r.y(j, 0) - y));
    size_of_y = std::max(size_of_y, y);
  }
  return std::max(of_q / q.cwiseAbs().maxCoeff(), of_y / size_of_y);
}

TEST(Doubts, NoLargeErrorIsSilent) {
  const auto backend = make_cpu_backend();
  Index large = 0, useless = 0;
  for (const double mu : {1.0, 0.1, 1e-2, 1e-3, 1e-4})
    for (const Index J : {10, 50, 100, 400, 1600})
      for (const NonlinearMethod method : {NonlinearMethod::march, NonlinearMethod::pointwise}) {
        NonlinearOptions options;
        options.steps = J;
        options.method = method;
        const NonlinearResult r = solve_nonlinear(stop(mu), *backend, options);
        if (r.status != Status::solved) {
          EXPECT_NE(r.reason.find("more steps"), std::string::npos) << r.reason;
          useless += r.error_estimate && *r.error_estimate > 1;
          continue;
        }
        // What is off by more than all of it is no solution.
        EXPECT_LE(r.error_estimate.value_or(0), 1) << mu << " " << J;
        const double error = error_of(r, mu);
        if (error > 0.1) {
          ++large;
          EXPECT_NE(r.warning.find("use more steps"), std::string::npos) << mu << " " << J << " " << error;
        }
        // Two grids of order 1 to 2 that differ by d: the coarser one is off by d 4/3 to 2 d; a factor of 3 is left for
        // contacts, which fall differently on the two grids.
        if (r.error_estimate) {
          EXPECT_GT(*r.error_estimate, error / 6) << mu << " " << J;
        }
      }
  EXPECT_GT(large, 0);  // of the kind that used to be silent
  EXPECT_GT(useless, 0);
}

// A soft contact with many steps raises no doubt, and is not solved twice.
TEST(Doubts, SmoothResultsAreNotSolvedAgain) {
  const auto backend = make_cpu_backend();
  NonlinearOptions options;
  options.steps = 4000;
  const NonlinearResult r = solve_nonlinear(stop(1), *backend, options);
  ASSERT_EQ(r.status, Status::solved);
  EXPECT_LT(error_of(r, 1), 1e-3);
  EXPECT_FALSE(r.error_estimate);
  EXPECT_EQ(r.warning, "");
  EXPECT_EQ(doubts_of(stop(1), r, {}), "");
  options.steps = 50;
  options.confirm = false;
  const NonlinearResult coarse = solve_nonlinear(stop(1e-3), *backend, options);
  EXPECT_EQ(coarse.status, Status::solved);
  EXPECT_NE(doubts_of(stop(1e-3), coarse, {}), "");
}

// Where y may jump: x' = 1 - x^3 with x held at 1/2 by y (M = 0). x is 1/2 from the time on at which the free solution
// gets there, and y = 1 - 1/8 then jumps from 0: of first order in the integral of y, h/2 at most.
TEST(Doubts, JumpsOfForcesAreEstimated) {
  const auto backend = make_cpu_backend();
  NonlinearScene s = cubic_stop();
  s.linear.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{-1}}, Matrix{{-1}}};
  s.linear.M = Matrix{{0}};
  s.linear.f = [](double, Eigen::Ref<Vector> v) { v[0] = 1; };
  s.linear.g = [](double, Eigen::Ref<Vector> v) { v[0] = 0.5; };
  s.linear.x0 = Vector{{0}};
  s.linear.T = 1;
  s.phi = [](double, In x, In, Eigen::Ref<Vector> v) { v[0] = -std::pow(x[0], 3); };
  s.dphi = {};
  NonlinearOptions options;
  options.steps = 37;
  const NonlinearResult r = solve_nonlinear(s, *backend, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  ASSERT_FALSE(r.continuous);
  ASSERT_TRUE(r.error_estimate);
  EXPECT_LT(*r.error_estimate, 2 * (1.0 / 37));  // the integral of y is 0.4, a step of it 0.024
  EXPECT_NEAR(r.x(37, 0), 0.5, 1e-9);
}

// The words of linear scenes for sources that the steps do not follow.
TEST(Doubts, CoarseSourcesAreNamed) {
  const auto backend = make_cpu_backend();
  NonlinearScene s = stop(1);
  s.linear.f = [](double t, Eigen::Ref<Vector> v) { v << 0, k * std::sin(400 * t); };
  NonlinearOptions options;
  options.steps = 100;
  const NonlinearResult r = solve_nonlinear(s, *backend, options);
  EXPECT_NE((r.warning + r.reason).find("f or g changes too fast for these steps"), std::string::npos)
      << r.warning << r.reason;
}

}  // namespace
}  // namespace bromwich

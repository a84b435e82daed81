// March under a tolerance on steps of their own lengths: closed forms of free boundaries and of layers, uniform steps
// as a special case, and other units.

#include "catalogue/catalogue.hpp"
#include "core/adapted/radau_steps.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace bromwich::adapted_test {
namespace {

Result to_tolerance(const Scene& scene, double tolerance) {
  Options options;
  options.method = Method::march;
  options.tolerance = tolerance;
  options.states = StateSelection::all;
  return solve(scene, *make_cpu_backend(1), options);
}

Matrix identity(Index m) { return Matrix::Identity(m, m); }

// x follows an obstacle, x = g(t), y = g' - a x: M = 0 and one constraint for each state.
Scene held(const std::vector<double>& rates, const TimeFunction& g, double T) {
  const Index m = Index(rates.size());
  Scene scene;
  Matrix A = Matrix::Zero(m, m);
  for (Index i = 0; i < m; ++i) A(i, i) = rates[std::size_t(i)];
  scene.dynamics = DenseDynamics{A, identity(m), identity(m)};
  scene.M = Matrix(Matrix::Zero(m, m));
  scene.lcp_class = LcpClass::PSD;
  scene.x0 = Vector::Zero(m);
  scene.g = g;
  scene.T = T;
  scene.default_steps = 64;
  return scene;
}

// x = sqrt(t): equal steps have an error of the square root of the first one.
TEST(AdaptedMarch, FollowsASquareRoot) {
  const Scene scene = held(
      {0}, [](double t, Eigen::Ref<Vector> g) { g << -std::sqrt(t); }, 1);
  for (const double tolerance : {1e-3, 1e-5}) {
    const Result r = to_tolerance(scene, tolerance);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    for (Index j = 1; j <= r.steps; ++j) {
      EXPECT_NEAR(r.x(j, 0), std::sqrt(r.t[j]), tolerance) << j;
      EXPECT_NEAR(r.y_integral(j, 0), std::sqrt(r.t[j]), tolerance) << j;
    }
    EXPECT_LE(r.lcp.solved, 20000);
  }
}

// Two constraints that are left at known times: x = max of the obstacle so far, as x' = y.
TEST(AdaptedMarch, FindsReleasesAtAnyTime) {
  const Scene scene = held(
      {0, 0}, [](double t, Eigen::Ref<Vector> g) { g << -std::sin(5.1 * t), -std::sin(3.3 * t); }, 1.2);
  const double tolerance = 1e-6;
  const Result r = to_tolerance(scene, tolerance);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  const double until = std::numbers::pi / 2;
  for (Index j = 1; j <= r.steps; ++j) {
    EXPECT_NEAR(r.x(j, 0), std::sin(std::min(5.1 * r.t[j], until)), tolerance) << j;
    EXPECT_NEAR(r.x(j, 1), std::sin(std::min(3.3 * r.t[j], until)), tolerance) << j;
  }
}

// A stiff state that starts off its constraint jumps onto it, and one that a source throws decays from there.
TEST(AdaptedMarch, TakesJumpsOfTheStateAndOfSources) {
  const double at = 0.3137, rate = 2000;
  Scene scene = held({-1, -rate}, {}, 1);
  scene.x0 << 0, 0;
  scene.g = [at](double t, Eigen::Ref<Vector> g) { g << (t < at ? 0 : -1), 10; };
  scene.f = [at, rate](double t, Eigen::Ref<Vector> f) { f << 0, (t < at ? 0 : rate); };
  scene.breakpoints = {at};
  scene.breakpoints_are_all = true;
  const Result r = to_tolerance(scene, 1e-5);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  for (Index j = 1; j <= r.steps; ++j) {
    const bool behind = r.t[j] > at;
    EXPECT_NEAR(r.x(j, 0), behind ? 1 : 0, 1e-5) << j;
    EXPECT_NEAR(r.x(j, 1), behind ? -std::expm1(-rate * (r.t[j] - at)) : 0, 1e-5) << j;
    EXPECT_NEAR(r.y_integral(j, 0), behind ? 1 + r.t[j] - at : 0, 2e-5) << j;
  }
}

// Heat in a bar of m points whose first one starts below 1, is lifted there at t = 0, and is held: the others approach
// a line from 0, in the sine modes of m - 1 points between ends at 1 and 0.
TEST(AdaptedMarch, FollowsAFieldBehindAnImpulse) {
  constexpr Index m = 40;
  constexpr double pi = std::numbers::pi, tolerance = 1e-5;
  Matrix A = Matrix::Zero(m, m);
  for (Index i = 0; i < m; ++i) {
    A(i, i) = -2.0 * m * m;
    if (i > 0) A(i, i - 1) = A(i - 1, i) = m * m;
  }
  Scene scene = held(
      {0}, [](double, Eigen::Ref<Vector> g) { g << -1; }, 0.5);
  scene.dynamics = DenseDynamics{A, identity(m).leftCols(1), identity(m).topRows(1)};
  scene.x0 = Vector::Zero(m);
  const Result r = to_tolerance(scene, tolerance);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  ASSERT_TRUE(r.starts_with_impulse);
  for (Index j = 1; j <= r.steps; ++j) {
    Vector exact = Vector::LinSpaced(m, 1, 1.0 / m);
    for (Index k = 1; k < m; ++k) {
      Vector mode(m);
      for (Index i = 0; i < m; ++i) mode[i] = std::sin(pi * double(k * i) / m);
      const double rate = 4.0 * m * m * std::pow(std::sin(pi * double(k) / (2 * m)), 2);
      exact -= 2.0 / m * mode.dot(Vector::LinSpaced(m, 1, 1.0 / m)) * std::exp(-rate * r.t[j]) * mode;
    }
    EXPECT_LE((r.x.row(j).transpose() - exact).cwiseAbs().maxCoeff(), tolerance) << j;
    EXPECT_GE(r.y_integral(j, 0), 1) << "the impulse";
  }
}

// A relay: y_1 is 2 + r x_3 while x_2 is below c, where y_2 = c - x_2, and jumps to 0 there, between any two nodes of a
// step. With x_2' = 1 + y_1 / 2 and x_3' = y_2 / 2 the first phase is an oscillation of frequency sqrt(r) / 2.
TEST(AdaptedMarch, FindsJumpsOfYAtAnyTime) {
  constexpr double tolerance = 1e-4, r = 0.04, omega = 0.1;
  Scene scene = held({0, 0}, {}, 1);
  scene.dynamics = DenseDynamics{Matrix::Zero(3, 3), Matrix{{1, 0}, {0.5, 0}, {0, 0.5}}, Matrix{{0, 1, 0}, {0, 0, r}}};
  scene.M = Matrix{{0, 1}, {-1, 0}};
  scene.x0 = Vector::Zero(3);
  scene.f = [](double, Eigen::Ref<Vector> f) { f << -1, 1, 0; };
  for (int k = 0; k < 40; ++k) {
    const double c = 1 + k / 1280.0, until = std::atan(c * omega / 2) / omega;
    scene.g = [c](double, Eigen::Ref<Vector> g) { g << -c, 2; };
    const Result found = to_tolerance(scene, tolerance);
    ASSERT_EQ(found.status, Status::solved) << found.reason;
    for (Index j = 1; j <= found.steps; ++j) {
      const double on = std::min(found.t[j], until);
      const double below = c * std::cos(omega * on) - 2 / omega * std::sin(omega * on);  // c - x_2
      const double integral = 2 * (c - below - on);
      EXPECT_NEAR(found.x(j, 0), integral - found.t[j], tolerance) << c << ' ' << found.t[j];
      EXPECT_NEAR(found.y_integral(j, 0), integral, tolerance) << c << ' ' << found.t[j];
    }
  }
}

Scene melting(Index m, double T) {
  const double dx = 1 / double(m + 1);
  Matrix A = Matrix::Zero(m, m);
  for (Index i = 0; i < m; ++i) {
    A(i, i) = -2 / (dx * dx);
    if (i > 0) A(i, i - 1) = A(i - 1, i) = 1 / (dx * dx);
  }
  Scene scene = held(std::vector<double>(std::size_t(m), 0), {}, T);
  scene.dynamics = DenseDynamics{A, identity(m), identity(m)};
  scene.f = [dx](double t, Eigen::Ref<Vector> f) {
    f.setConstant(-1);
    f[0] += t / (dx * dx);
  };
  return scene;
}

// Neumann's solution for Stefan number 1: the front at 2 la sqrt(t), la e^{la^2} erf(la) = 1/sqrt(pi), temperature
// u = 1 - erf(x / (2 sqrt t)) / erf(la), and w = ∫ u dt from the time at which the front has passed.
double neumann(double x, double t) {
  const double la = 0.620062633313;
  const double from = x * x / (4 * la * la);
  if (t <= from) return 0;
  constexpr int parts = 400;  // Simpson's rule in sqrt(s)
  const double a = std::sqrt(from), h = (std::sqrt(t) - a) / parts;
  double sum = 0;
  for (int k = 0; k <= parts; ++k) {
    const double r = a + k * h, u = 1 - std::erf(x / (2 * r)) / std::erf(la);
    sum += (k == 0 || k == parts ? 1 : k % 2 == 0 ? 2 : 4) * 2 * r * u;
  }
  return sum * h / 3;
}

// 40 cells are known to (dx^2) / 12 times the fourth derivative of w, 1e-5 of it here; the steps are not seen beside
// it.
TEST(AdaptedMarch, MeltsAsNeumannsSolution) {
  const Index m = 40;
  const Result r = to_tolerance(melting(m, 0.25), 1e-4);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  for (Index j = 8; j <= r.steps; j += 8)
    for (Index i = 0; i < m; ++i)
      EXPECT_NEAR(r.x(j, i), neumann(double(i + 1) / double(m + 1), r.t[j]), 1.5e-4) << r.t[j] << ' ' << i;
  EXPECT_LE(r.errors->grids.back(), 2000);
}

// An American put by a binomial tree of 4000 dates, which errs by 1e-3 or less. The 120 points err by 4e-3.
double binomial_put(double S, double K, double r, double sigma, double T, int dates) {
  const double dt = T / dates, up = std::exp(sigma * std::sqrt(dt)), p = (std::exp(r * dt) - 1 / up) / (up - 1 / up);
  std::vector<double> value(std::size_t(dates) + 1);
  const auto payoff = [&](int date, int k) { return std::max(0.0, K - S * std::pow(up, 2 * k - date)); };
  for (int k = 0; k <= dates; ++k) value[std::size_t(k)] = payoff(dates, k);
  for (int date = dates - 1; date >= 0; --date)
    for (int k = 0; k <= date; ++k)
      value[std::size_t(k)] = std::max(
          payoff(date, k), std::exp(-r * dt) * (p * value[std::size_t(k) + 1] + (1 - p) * value[std::size_t(k)]));
  return value[0];
}

TEST(AdaptedMarch, ValuesAnAmericanPut) {
  Scene scene = make_scene("put", {{"points", 120}});
  scene.default_steps = 100;
  const Result r = to_tolerance(scene, 1e-4);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  const auto& names = scene.names.x;
  const Index spot = std::find(names.begin(), names.end(), "spot") - names.begin();
  EXPECT_NEAR(r.x(r.steps, spot), binomial_put(100, 100, 0.05, 0.2, 1, 4000), 5e-3);
  EXPECT_LE(r.lcp.solved, 6000);
}

// Numbers without units: the same steps in any of them.
TEST(AdaptedMarch, IsThatOfAnyUnits) {
  Result first;
  for (const double unit : {1.0, 1e-9, 1e6}) {
    Scene scene = held(
        {-3 * unit}, [unit](double t, Eigen::Ref<Vector> g) { g << -std::sin(4 * t * unit) / unit; }, 2 / unit);
    const Result r = to_tolerance(scene, 1e-4);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    if (unit == 1) first = r;
    EXPECT_EQ(r.errors->grids.back(), first.errors->grids.back()) << unit;
    EXPECT_LE((unit * r.x - first.x).cwiseAbs().maxCoeff(), 1e-9) << unit;
  }
}

// Steps of one length are those of method march.
TEST(RadauStepsOfATree, AreThoseOfMarch) {
  const Scene scene = melting(12, 0.1);
  const Index J = 40;
  Options options;
  options.method = Method::march;
  options.steps = J;
  options.states = StateSelection::all;
  const Result march = solve(scene, *make_cpu_backend(1), options);
  ASSERT_EQ(march.status, Status::solved) << march.reason;
  RadauSteps steps(scene, LcpClass::PSD);
  const double h = scene.T / double(J);
  const Index begin = 10;  // march takes the first steps by implicit Euler: the state jumps
  TreeRow row{march.x.row(begin).transpose(), march.y.row(begin).transpose(), Vector::Zero(12)};
  for (Index j = begin + 1; j <= J; ++j) {
    Part whole;
    whole.end = 1;
    whole.length = h;
    whole.from = double(j - 1) * h;
    whole.to = double(j) * h;
    TreeRow next;
    ASSERT_TRUE(steps.take(whole, row, next)) << j;
    row = next;
    if (march.euler_steps == 0) {
      EXPECT_LE((row.x.transpose() - march.x.row(j)).cwiseAbs().maxCoeff(), 1e-12) << j;
    }
  }
  EXPECT_LE((row.x.transpose() - march.x.row(J)).cwiseAbs().maxCoeff(), 1e-4);
}

}  // namespace
}  // namespace bromwich::adapted_test

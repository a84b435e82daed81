// The event-located oracle on scenes with known solutions, on scenes that it must leave undecided, and against implicit
// Euler on a sequence of grids.

#include "tests/support/oracle_events.hpp"
#include "tests/support/random_sources.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include <cmath>
#include <numbers>

namespace bromwich::oracle::events_test {
namespace {

constexpr double pi = std::numbers::pi;

EventScene scene(const Matrix& A, const Matrix& B, const Matrix& N, const Matrix& M, const Vector& x0, double T) {
  EventScene e;
  const auto zero = [](double, Eigen::Ref<Vector> v) { v.setZero(); };
  e.scene = {A, B, N, M, LcpClass::unknown, zero, zero, x0, T};
  return e;
}

Matrix matrix(Index rows, Index cols, std::initializer_list<double> values) {
  return Eigen::Map<const RowMatrix>(values.begin(), rows, cols);
}

void expect_near(const Vector& found, std::initializer_list<double> expected, double tolerance) {
  ASSERT_EQ(found.size(), Index(expected.size()));
  for (Index i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], expected.begin()[i], tolerance) << i;
}

// lambda in -Sgn(C x): y holds s and the negative part of C x.
EventScene relay(const Matrix& A, const Matrix& B, const Matrix& C, const Vector& x0, double T) {
  const Index k = C.rows(), m = A.rows();
  Matrix drive = Matrix::Zero(m, 2 * k), seen = Matrix::Zero(2 * k, m), M = Matrix::Zero(2 * k, 2 * k);
  drive.leftCols(k) = -2 * B;
  seen.topRows(k) = -C;
  M.topRightCorner(k, k).setIdentity();
  M.bottomLeftCorner(k, k) = -Matrix::Identity(k, k);
  EventScene e = scene(A, drive, seen, M, x0, T);
  const Vector all = B * Vector::Ones(k);
  e.scene.f = [all](double, Eigen::Ref<Vector> v) { v = all; };
  e.scene.g = [k](double, Eigen::Ref<Vector> v) {
    v.setZero();
    v.tail(k).setOnes();
  };
  return e;
}

TEST(OracleEvents, PulseByHand) {
  // x' = -x/0.8 + f, f = 175.676 on (a, b): x(1) = 0.8 * 175.676 (e^{-(1-b)/0.8} - e^{-(1-a)/0.8}).
  const double a = 0.2754, b = 0.2902, r = 1 / 0.8;
  EventScene e = scene(matrix(1, 1, {-r}), matrix(1, 1, {1}), matrix(1, 1, {1}), matrix(1, 1, {0}), Vector::Zero(1), 1);
  e.scene.f = [=](double t, Eigen::Ref<Vector> v) { v[0] = t >= a && t < b ? 175.676 : 0; };
  e.scene.g = [](double, Eigen::Ref<Vector> v) { v[0] = 1; };
  e.breaks = {a, b};
  const EventSolution s = locate_events(e);
  ASSERT_TRUE(s.decided) << s.reason;
  EXPECT_NEAR(s.x(1)[0], 175.676 / r * (std::exp(-r * (1 - b)) - std::exp(-r * (1 - a))), 1e-12);
}

TEST(OracleEvents, Circuits) {
  const double L = 1e-2, C = 1e-6, R = 1e3, F = 3e-7;
  const Matrix A = matrix(2, 2, {0, -1 / C, 1 / L, 0});
  const Vector x0 = matrix(2, 1, {10, 0});
  const EventSolution rlcd =
      locate_events(scene(A, matrix(2, 1, {-1 / C, 0}), matrix(1, 2, {-1, 0}), matrix(1, 1, {R}), x0, 5e-3));
  ASSERT_TRUE(rlcd.decided) << rlcd.reason;
  expect_near(rlcd.x(5e-3), {2.800403336293, -8.439617044e-3}, 1e-11);
  ASSERT_GT(rlcd.pieces.size(), 1u);
  double first = 0;
  for (const EventPiece& p : rlcd.pieces)
    if (p.end < p.begin + p.length) {
      first = p.end;
      break;
    }
  EXPECT_NEAR(first, 1.5226800110860623e-4, 1e-14);

  const Matrix M = matrix(4, 4, {1 / R, 1 / R, -1, 0, 1 / R, 1 / R, 0, -1, 1, 0, 0, 0, 0, 1, 0, 0});
  const EventSolution bridge = locate_events(
      scene(A, matrix(2, 4, {0, 0, -1 / C, 1 / C, 0, 0, 0, 0}), matrix(4, 2, {0, 0, 0, 0, -1, 0, 1, 0}), M, x0, 5e-3));
  ASSERT_TRUE(bridge.decided) << bridge.reason;
  expect_near(bridge.x(5e-3), {.7903228196444, -2.647850160e-3}, 1e-11);

  // The charge jumps to (10/1.3, 0, 10/1.3).
  const Matrix skew = matrix(4, 4, {0, -1, 0, 0, 1, 0, 1, -1, 0, -1, 0, 0, 0, 1, 0, 0});
  EventScene filter = scene(matrix(3, 3, {0, -1 / C, 0, 1 / L, 0, 0, 0, 0, -1 / (R * F)}),
                            matrix(3, 4, {0, 0, -1 / C, 1 / C, 0, 0, 0, 0, 1 / F, 0, 1 / F, 0}),
                            matrix(4, 3, {0, 0, 1, 0, 0, 0, -1, 0, 1, 1, 0, 0}), skew, matrix(3, 1, {10, 0, 0}), 5e-3);
  const EventSolution filtered = locate_events(filter);
  ASSERT_TRUE(filtered.decided) << filtered.reason;
  EXPECT_EQ(filtered.jumps, 1);
  expect_near(filtered.x(0), {10 / 1.3, 0, 10 / 1.3}, 1e-11);
}

TEST(OracleEvents, RelaysThatCrossAndSlide) {
  const EventSolution spiral = locate_events(relay(Matrix::Zero(2, 2), 500 * matrix(2, 2, {.01, .99, -.99, .01}),
                                                   Matrix::Identity(2, 2), matrix(2, 1, {10, 10}), 0.1));
  ASSERT_TRUE(spiral.decided) << spiral.reason;
  std::vector<double> crossings;
  for (const EventPiece& p : spiral.pieces)
    if (p.end < p.begin + p.length) crossings.push_back(p.end);
  ASSERT_GE(crossings.size(), 3u);
  EXPECT_NEAR(crossings[0], 0.02, 1e-12);
  EXPECT_NEAR(crossings[1], 0.0596, 1e-12);
  EXPECT_NEAR(crossings[2], 0.098408, 1e-12);

  const EventSolution sliding =
      locate_events(relay(matrix(3, 3, {-3, 1, 0, -3, 0, 1, -1, 0, 0}), matrix(3, 1, {1, -2, 1}),
                          matrix(1, 3, {1, 0, 0}), matrix(3, 1, {0, .5, 0}), 20));
  ASSERT_TRUE(sliding.decided) << sliding.reason;
  expect_near(sliding.x(5), {-1.10196424, -4.32627263, -.39378773}, 1e-8);
  expect_near(sliding.x(20), {.35377174, 1.44565721, -2.70235922}, 1e-8);
}

TEST(OracleEvents, QueuesAtBottlenecks) {
  Matrix S = Matrix::Zero(3, 3);
  S(1, 0) = S(2, 1) = 1;
  const Matrix I = Matrix::Identity(3, 3);
  EventScene e = scene(Matrix::Zero(3, 3), I - S, I, Matrix::Zero(3, 3), Vector::Zero(3), 6);
  e.scene.f = [](double t, Eigen::Ref<Vector> v) { v << (t < 2 ? 2 * std::sin(pi * t / 2) : 0) - 1, .2, .2; };
  e.breaks = {2};
  const EventSolution s = locate_events(e);
  ASSERT_TRUE(s.decided) << s.reason;
  EXPECT_NEAR(s.x(5. / 3)[0], .87198225, 1e-8);  // inflow equals outflow: 2 sin(pi t / 2) = 1
  // A queue ends when it becomes 0 for good.
  const double ends[] = {2.70923067, 3.31220834, 4.34036113};
  for (Index i = 0; i < 3; ++i) {
    EXPECT_GT(s.x(ends[i] - 1e-3)[i], 1e-5);
    EXPECT_NEAR(s.x(ends[i] + 1e-7)[i], 0, 1e-10);
  }
}

TEST(OracleEvents, SuspensionBridge) {
  EventScene e = scene(matrix(2, 2, {0, 1, -4, 0}), matrix(2, 1, {0, -3}), matrix(1, 2, {1, 0}), matrix(1, 1, {1}),
                       matrix(2, 1, {0, 1}), 3 * pi);
  e.scene.f = [](double t, Eigen::Ref<Vector> v) { v << 0, std::sin(4 * t); };
  const EventSolution s = locate_events(e);
  ASSERT_TRUE(s.decided) << s.reason;
  expect_near(s.x(3 * pi), {0, 1 + 4. / 15}, 1e-11);
}

TEST(OracleEvents, WhatItCannotDecideIsNotDecided) {
  // x' in Sgn x from 0: three solutions.
  EventScene sign = relay(matrix(1, 1, {0}), matrix(1, 1, {-1}), matrix(1, 1, {1}), Vector::Zero(1), 1);
  EXPECT_FALSE(locate_events(sign).decided);
  EXPECT_NE(locate_events(sign).reason.find("not unique"), std::string::npos);
  // w = x - 1 - y: no solution if x < 1.
  EventScene none =
      scene(matrix(1, 1, {0}), matrix(1, 1, {0}), matrix(1, 1, {1}), matrix(1, 1, {-1}), Vector::Zero(1), 1);
  none.scene.g = [](double, Eigen::Ref<Vector> v) { v[0] = -1; };
  EXPECT_FALSE(locate_events(none).decided);
  // A mass falls on a rigid floor: relative degree two, for which no impact law is defined.
  EventScene ball = scene(matrix(2, 2, {0, 1, 0, 0}), matrix(2, 1, {0, 1}), matrix(1, 2, {1, 0}), matrix(1, 1, {0}),
                          matrix(2, 1, {1, 0}), 2);
  ball.scene.f = [](double, Eigen::Ref<Vector> v) { v << 0, -9.81; };
  const EventSolution falls = locate_events(ball);
  EXPECT_FALSE(falls.decided);
  EXPECT_NEAR(falls.until, std::sqrt(2 / 9.81), 1e-10);
}

// Implicit Euler is of first order where y may jump.
TEST(OracleEvents, ImplicitEulerComesCloser) {
  Index compared = 0;
  double all_coarse = 0, all_fine = 0;
  for (std::uint32_t seed = 0; seed < 66; ++seed) {
    const SourceScene s = source_scene(seed);
    if (s.sources.find("fast") != std::string::npos || s.sources.find("pulse") != std::string::npos ||
        s.sources.find("bump") != std::string::npos || s.spectrum == Spectrum::unstable)
      continue;
    const EventSolution truth = locate_events(s.base);
    if (!truth.decided) continue;
    const Vector size = measure(truth.largest_x()), exact = truth.x(s.base.scene.T);
    const auto error = [&](Index J) -> double {
      const Trajectory t = trajectory(s.base.scene, Scheme::euler, J);
      if (t.infeasible >= 0) return NAN;
      return (t.x.row(J).transpose() - exact).cwiseAbs().cwiseQuotient(size).maxCoeff();
    };
    const double coarse = error(1000), fine = error(4000);
    if (std::isnan(coarse) || std::isnan(fine)) continue;  // a singular problem at the start
    ++compared;
    EXPECT_LE(fine, 0.02) << seed << ' ' << s.sources;
    all_coarse += coarse;
    all_fine += fine;
  }
  // A source that jumps inside a step makes single errors irregular; on the whole they fall with the grid.
  EXPECT_LE(all_fine, 0.4 * all_coarse);
  EXPECT_GE(compared, 20);
}

TEST(OracleEvents, PerturbationsKeepTheirKind) {
  for (std::uint32_t seed = 0; seed < 44; ++seed) {
    const SourceScene s = source_scene(seed);
    const DenseScene &a = s.base.scene, b = perturbed(s.base, 1e-3, seed).scene;
    const Matrix symmetric = a.M - a.M.transpose(), skew = a.M + a.M.transpose();
    EXPECT_EQ(symmetric.isZero(0), (b.M - b.M.transpose()).isZero(1e-15)) << seed;
    EXPECT_EQ(skew.isZero(0), (b.M + b.M.transpose()).isZero(1e-15)) << seed;
    EXPECT_LE((b.A - a.A).cwiseAbs().maxCoeff(), 1.0000001e-3 * a.A.cwiseAbs().maxCoeff());
    EXPECT_EQ(a.N == a.B.transpose(), b.N == b.B.transpose()) << seed;
  }
}

}  // namespace
}  // namespace bromwich::oracle::events_test

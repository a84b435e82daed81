// Forecasts of the remaining sweeps from observed ones, and iterations that end because of them.

#include "core/iteration/sweep_forecast.hpp"

#include "core/scene/relay.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

TEST(SweepForecast, AFrontThatMovesSteadily) {
  SweepForecast f(1000, 1e-12, 2000);
  for (Index k = 1; k <= 80; ++k) {
    EXPECT_EQ(f.sweeps_left().has_value(), k > SweepForecast::fewest_seen);
    f.add(2 * k, 1e3);
  }
  EXPECT_NEAR(*f.sweeps_left(), (1001 - 160) / 2.0, 1e-9);
  EXPECT_FALSE(f.hopeless());
}

TEST(SweepForecast, ChangesThatFall) {
  SweepForecast f(1000, 1e-12, 2000);
  for (Index k = 1; k <= 96; ++k) f.add(1, std::pow(0.9, double(k)));
  // ln(1e-12 / 0.9^96) / ln 0.9 = 166; the smallest change of each half is its last.
  EXPECT_NEAR(*f.sweeps_left(), 166.3, 1);
  EXPECT_FALSE(f.hopeless());
}

// A Volterra iteration: changes (L T)^k / k! grow up to k = L T and must not stop it.
TEST(SweepForecast, ChangesThatGrowFirst) {
  constexpr double LT = 100;
  constexpr Index J = 1000;
  SweepForecast f(J, 1e-12, 2000);
  for (Index k = 1;; ++k) {
    Index settled = 0;
    double largest = 0;
    for (Index j = 0; j <= J; ++j) {
      const double log_change = double(k) * std::log(LT * double(j) / double(J)) - std::lgamma(double(k) + 1);
      largest = std::max(largest, j > 0 ? std::exp(log_change) : 0);
      if (settled == j && (j == 0 || log_change < std::log(1e-14))) ++settled;
    }
    f.add(settled, largest);
    ASSERT_FALSE(f.hopeless()) << k << ": " << *f.hopeless();
    if (largest <= 1e-12) break;
    ASSERT_LE(k, 1000);
  }
}

TEST(SweepForecast, OutOfReach) {
  SweepForecast slow(100000, 1e-12, 2000), small(1000, 1e-12, 2000);
  for (Index k = 1; k <= 96; ++k)
    for (SweepForecast* f : {&slow, &small}) f->add(k, 1);
  ASSERT_TRUE(slow.hopeless());  // one row per sweep: 1e5 sweeps
  EXPECT_NE(slow.hopeless()->find("about 1e+05 more"), std::string::npos) << *slow.hopeless();
  EXPECT_FALSE(small.hopeless());
}

TEST(SweepForecast, TheRowAtTheFront) {
  FrontRow falling, standing, moving;
  for (int k = 0; k < 100; ++k) {
    const double sign = k % 2 == 0 ? 1 : -1;
    const auto falls = falling.contracts(3, Vector{{std::pow(0.97, k)}}),
               stands = standing.contracts(3, Vector{{sign}});
    EXPECT_TRUE(!falls || *falls) << k;
    EXPECT_EQ(stands.has_value(), k >= FrontRow::seen) << k;
    if (stands) {
      EXPECT_FALSE(*stands) << k;
      EXPECT_NEAR(standing.factor(), 1, 1e-12);
    }
    EXPECT_FALSE(moving.contracts(k / 4, Vector{{sign}}).has_value()) << "each row is looked at anew";
  }
}

/// A chain of braking wagons with saturating friction; the compliances `soft` make M a P-matrix.
Scene wagons(Index count, double soft) {
  const Index m = 2 * count;
  Matrix A = Matrix::Zero(m, m), B = Matrix::Zero(m, count), C = Matrix::Zero(count, m);
  for (Index i = 0; i < count; ++i) {
    A(i, count + i) = C(i, count + i) = 1;
    B(count + i, i) = 2;
    for (const Index j : {i - 1, i + 1})
      if (j >= 0 && j < count) {
        A(count + i, i) -= 100;
        A(count + i, j) += 100;
        A(count + i, count + i) -= 1;
        A(count + i, count + j) += 1;
      }
  }
  Vector x0 = Vector::Zero(m);
  x0.tail(count).setLinSpaced(5, 8);
  Scene scene = relay_scene(A, B, C, {}, x0);
  std::get<Matrix>(scene.M).diagonal().setConstant(soft);
  scene.lcp_class = LcpClass::P;
  scene.T = 4;
  return scene;
}

// M = 1e-2 does not dominate the first lag for a wagon at rest: the sweeps end in a cycle, which is detected long
// before their limit. Marching solves it.
TEST(SweepForecast, BrakingWagons) {
  const Scene scene = wagons(6, 1e-2);
  EXPECT_EQ(run(scene, Method::march, 400).status, Status::solved);
  const Result r = run(scene, Method::contour, 400);
  ASSERT_EQ(r.status, Status::tolerance_not_met);
  EXPECT_NE(r.reason.find("do not contract at t ="), std::string::npos) << r.reason;
  EXPECT_NE(r.reason.find("use method march"), std::string::npos) << r.reason;
  EXPECT_LE(r.iterations, 160);
}

}  // namespace
}  // namespace bromwich

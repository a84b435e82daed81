// Undeclared jumps of sources, impulses, and the layers after them.

#include "core/lcp/active_set.hpp"
#include "core/scene/breakpoints.hpp"
#include "tests/support/run.hpp"
#include "tests/support/trust.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace bromwich {
namespace {

Scene with_g(TimeFunction g, double T = 1) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{1}};
  scene.g = std::move(g);
  scene.x0 = Vector{{0}};
  scene.T = T;
  return scene;
}

Scene with_g(double (*g)(double), double T = 1) {
  return with_g([g](double t, Eigen::Ref<Vector> v) { v[0] = g(t); }, T);
}

TEST(SourceBreakpoints, EdgesOfPulsesAreFoundToRounding) {
  for (const double T : {1.0, 3e-7, 4e9}) {
    const std::vector<double> edges{0.1234567, 0.12351, 0.5, 0.98765};
    const Scene scene = with_g(
        [&](double t, Eigen::Ref<Vector> g) {
          double value = std::sin(5 * t / T);
          for (const double e : edges) value += t >= e * T ? 1e-3 : 0;
          g[0] = value;
        },
        T);
    const std::vector<double> found = find_breakpoints(scene);
    ASSERT_EQ(found.size(), edges.size());
    for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], edges[i] * T, 16 * epsilon * T);
  }
}

TEST(SourceBreakpoints, KinksAreFound) {
  const auto check = [](double (*g)(double), const std::vector<double>& kinks) {
    const std::vector<double> found = find_breakpoints(with_g(g));
    ASSERT_EQ(found.size(), kinks.size());
    for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], kinks[i], 1e-9);
  };
  constexpr double pi = 3.14159265358979323846;
  check([](double t) { return std::abs(std::sin(10 * t)); }, {pi / 10, 2 * pi / 10, 3 * pi / 10});
  check([](double t) { return std::max(std::exp(3 * t), 7.0); }, {std::log(7.0) / 3});
  check([](double t) { return t < 0.4 ? t : 1.4 - 2 * t; }, {0.4});
}

// A jump and a kink of one component, beside another one that changes fast everywhere, or jumps next to the kink.
TEST(SourceBreakpoints, OneComponentDoesNotHideAnother) {
  Scene scene = with_g([](double) { return 0.0; });
  scene.M = Matrix::Identity(2, 2);
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1, 0}}, Matrix{{1}, {0}}};
  scene.g = [](double t, Eigen::Ref<Vector> v) {
    v[0] = std::sin(2500 * t);
    v[1] = t >= 0.3 ? 0.1 : 0;
  };
  std::vector<double> found = find_breakpoints(scene);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_NEAR(found[0], 0.3, 16 * epsilon);
  scene.g = [](double t, Eigen::Ref<Vector> v) {
    v[0] = std::max(0.0, t - 0.50003);
    v[1] = t >= 0.5 ? 1 : 0;
  };
  found = find_breakpoints(scene);
  ASSERT_EQ(found.size(), 2u);
  EXPECT_NEAR(found[0], 0.5, 16 * epsilon);
  EXPECT_NEAR(found[1], 0.50003, 1e-9);
}

// The same within one component: the kink is 2 of the 65536 times behind the jump.
TEST(SourceBreakpoints, AKinkBesideAJumpIsFound) {
  const std::vector<double> found =
      find_breakpoints(with_g([](double t) { return (t >= 0.5 ? 1.0 : 0.0) + 3 * std::max(0.0, t - 0.50003); }));
  ASSERT_EQ(found.size(), 2u);
  EXPECT_NEAR(found[0], 0.5, 16 * epsilon);
  EXPECT_NEAR(found[1], 0.50003, 1e-9);
}

TEST(SourceBreakpoints, WhatIsSmoothHasNone) {
  EXPECT_TRUE(find_breakpoints(with_g([](double t) { return std::exp(-1e4 * t); })).empty());
  EXPECT_TRUE(find_breakpoints(with_g([](double t) { return std::sin(3e4 * t); })).empty());
  EXPECT_TRUE(find_breakpoints(with_g([](double) { return 0.0; })).empty());
}

TEST(SourceBreakpoints, WhatIsFasterThanTheSearchHasNone) {
  EXPECT_TRUE(find_breakpoints(with_g([](double t) { return std::sin(3e9 * t) + 0.1 * std::sin(7e5 * t); })).empty());
}

TEST(SourceBreakpoints, NamedBreakpointsStayAsTheyAre) {
  Scene scene = with_g([](double t) { return t < 0.3 ? 0.0 : t < 0.7 ? 1.0 : 3.0; });
  scene.breakpoints = {0.1, 0.3};
  const std::vector<double> found = find_breakpoints(scene);
  ASSERT_EQ(found.size(), 3u);
  EXPECT_EQ(found[0], 0.1);
  EXPECT_EQ(found[1], 0.3);
  EXPECT_NEAR(found[2], 0.7, 16 * epsilon);
}

// x' = -x + y held at x = s(t) = 1 + t + t^2 from x0 = -1/2 on: y = s' + s, its integral
// s(t) - x0 + t + t^2/2 + t^3/3.
TEST(IntegralOfY, HoldsImpulsesAndHasTheOrderOfTheStages) {
  Scene scene = with_g([](double t) { return -1 - t - t * t; });
  scene.M = Matrix{{0}};
  scene.x0[0] = -0.5;
  const auto error = [&](Index J) {
    Options options;
    options.method = Method::march;
    options.steps = J;
    const Result r = run(scene, options);
    EXPECT_EQ(r.status, Status::solved) << r.reason;
    const RowMatrix found = integral_of_y(r);
    double largest = 0;
    for (Index j = 1; j <= J; ++j) {
      const double t = r.t[j];
      largest = std::max(largest, std::abs(found(j, 0) - (1.5 + 2 * t + 1.5 * t * t + t * t * t / 3)));
    }
    return largest;
  };
  // The part with the impulse is one of implicit Euler, d s(d) instead of the integral of s with d = h/J at most; the
  // others are exact. s' <= 3.
  for (const double J : {100.0, 200.0}) EXPECT_LE(error(Index(J)), 3 / (J * J * J * J) / 2);
  scene.x0[0] = 1;  // without an impulse; the quadrature is exact for polynomials of degree 2
  const auto smooth = [&](Index J) {
    Options options;
    options.method = Method::march;
    options.steps = J;
    const Result r = run(scene, options);
    return std::abs(integral_of_y(r)(J, 0) - (23.0 / 6));
  };
  EXPECT_LE(smooth(10), 1e-12);
}

TEST(IntegralOfY, IsThatOfLinearInterpolationWhereYIsContinuous) {
  Result r;
  r.t = Vector{{0, 1, 3}};
  r.y = RowMatrix{{0}, {1}, {2}};
  const RowMatrix sum = integral_of_y(r);
  EXPECT_EQ(sum(1, 0), 0.5);
  EXPECT_EQ(sum(2, 0), 3.5);
  r.method = Method::euler;
  EXPECT_EQ(integral_of_y(r)(2, 0), 5);
  r.method = Method::galerkin;
  r.y_left = RowMatrix{{2}, {4}};
  EXPECT_EQ(integral_of_y(r)(2, 0), 1.5 + 6);
}

// Impulses followed by layers of a thousandth of a default step, M skew or zero: steps that jump over a layer miss the
// next state by its size, however many there are.
TEST(Layers, AreFollowedBehindImpulses) {
  for (const std::uint32_t seed : {249u, 51u, 97u}) {
    const oracle::SourceScene s = oracle::source_scene(seed);
    const oracle::EventSolution truth = oracle::locate_events(s.base);
    ASSERT_TRUE(truth.decided) << truth.reason;
    Options options;
    options.tolerance = 3e-3;
    options.states = StateSelection::all;
    const Result r = solve(s.scene, *make_cpu_backend(1), options);
    ASSERT_EQ(r.status, Status::solved) << seed << ": " << r.reason;
    EXPECT_LE(oracle::true_error(s, truth, r).largest(), 3e-3) << seed;
  }
}

// An impulse of size 1/d in a skew M: the solution is as good as one without the small diagonal.
TEST(ActiveSetLcp, SolutionsLeaveResidualsOfRoundingHoweverIllConditioned) {
  const Vector b{{0.5, 0.3, -0.7}};
  for (const double d : {1e-3, 1e-6, 1e-9}) {
    const Matrix M = Matrix{{0, -0.39, 0.58}, {0.39, 0, -0.38}, {-0.58, 0.38, 0}} + d * b * b.transpose();
    const Vector direction{{0.38, 0.58, 0.39}};  // of the null space of the skew part
    for (int k = 0; k < 20; ++k) {
      ActiveSetLcp lcp(M, LcpClass::PSD);
      const Vector q = -M * direction * (1 + k) - Vector{{0, 1e-3 * k, 0}};
      Vector y;
      if (!lcp.solve(q, y).solved) continue;
      const Vector w = M * y + q;
      EXPECT_LE(y.cwiseMin(w).cwiseAbs().maxCoeff(), 64 * epsilon * (1 + y.cwiseAbs().maxCoeff())) << d << ' ' << k;
    }
  }
}

}  // namespace
}  // namespace bromwich

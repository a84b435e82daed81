// Impacts with restitution against closed forms, and values of an event-located reference.

#include "core/base/error.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/events/bouncing.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <optional>
#include <random>
#include <string>
#include <vector>

namespace bromwich {
namespace {

constexpr double gravity = 9.81;

/// x = (q, q'), q'' = -g + y, q >= 0 ⊥ y.
Scene ball(double e, double T, double height = 1) {
  Scene s;
  s.dynamics = DenseDynamics{Matrix{{0, 1}, {0, 0}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  s.M = Matrix{{0}};
  s.f = constant(Vector{{0, -gravity}});
  s.breakpoints_are_all = true;
  s.x0 = Vector{{height, 0}};
  s.restitution = Vector{{e}};
  s.T = T;
  return s;
}

/// q and q' of the ball from height 1, not at an impact.
Vector fallen(double e, double t) {
  double begin = 0, v = -std::sqrt(2 * gravity), impact = std::sqrt(2 / gravity);
  if (t < impact) return Vector{{1 - gravity * t * t / 2, -gravity * t}};
  for (begin = impact; std::abs(v) > 1e-12; begin = impact) {
    v *= -e;
    impact = begin + 2 * v / gravity;
    if (t < impact) return Vector{{(t - begin) * (v - gravity * (t - begin) / 2), v - gravity * (t - begin)}};
    v = -v;
  }
  return Vector::Zero(2);
}

Result solved(const Scene& scene, Index steps, double tolerance = 0) {
  Options o;
  o.steps = steps;
  o.tolerance = tolerance;
  if (tolerance == 0) o.method = Method::events;
  o.states = StateSelection::all;
  return solve(scene, *make_cpu_backend(1), o);
}

TEST(Restitution, ABallBouncesAsItsClosedForm) {
  for (const double e : {0.2, 0.5, 0.9, 1.0})
    for (const double tolerance : {0.0, 1e-6}) {
      const Result r = solved(ball(e, 2), 400, tolerance);
      ASSERT_EQ(r.status, Status::solved) << e << ": " << r.reason;
      EXPECT_EQ(r.method, Method::events);
      for (Index j = 0; j <= r.steps; ++j) {
        const Vector expected = fallen(e, r.t[j]);
        // An impact moves by rounding, and a row beside it has the speed of either side: such rows are passed over.
        if (std::abs(fallen(e, r.t[j] - 1e-6)[1] - fallen(e, r.t[j] + 1e-6)[1]) > 0.1) continue;
        EXPECT_NEAR(r.x(j, 0), expected[0], 1e-9) << "e = " << e << ", t = " << r.t[j];
        EXPECT_NEAR(r.x(j, 1), expected[1], 1e-8) << "e = " << e << ", t = " << r.t[j];
      }
    }
}

// With e = 1/2 it rests from 3 sqrt(2/g) on: y carries the weight. Impulses add to what the weight takes.
TEST(Restitution, BouncesEndAtRest) {
  const Result r = solved(ball(0.5, 2), 200);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  const double rest = 3 * std::sqrt(2 / gravity);
  for (Index j = 0; j <= 200; ++j)
    if (r.t[j] > rest + 1e-6) {
      EXPECT_NEAR(r.y(j, 0), gravity, 1e-6) << r.t[j];
      EXPECT_NEAR(r.x(j, 0), 0, 1e-12) << r.t[j];
    }
  // m q' from 0 to 0: the integral of y is that of the weight.
  EXPECT_NEAR(integral_of_y(r)(200, 0), 2 * gravity, 1e-8);
}

// Without a force between two walls, e of each its own: speeds are e_1 e_2 e_1 ... v. The impacts are at rows but for
// rounding: two integrations may have them on different sides.
TEST(Restitution, EachConstraintHasItsOwn) {
  for (const double mirror : {1.0, -1.0})
    for (const int ulps : {-7, -1, 0, 1, 7}) {
      Scene s;
      s.dynamics =
          DenseDynamics{Matrix{{0, 1}, {0, 0}}, Matrix{{0, 0}, {mirror, -mirror}}, Matrix{{mirror, 0}, {-mirror, 0}}};
      s.M = Matrix::Zero(2, 2);
      s.g = constant(Vector{{0, 1}});  // 0 <= mirror q <= 1
      s.breakpoints_are_all = true;
      s.x0 = Vector{{mirror * 0.5 * (1 + ulps * epsilon), -mirror * 1.0}};
      s.restitution = Vector{{0.5, 0.8}};
      s.T = 6;
      const Result r = solved(s, 60);
      ASSERT_EQ(r.status, Status::solved) << ulps << " " << r.reason;
      // At the wall 0 from 0.5 on, with 1/2; at the wall 1 from 2.5 on, with 0.4; at 0 again from 5 on, with 0.2.
      for (const auto& [t, q, v] :
           std::vector<std::array<double, 3>>{{0.3, 0.2, -1}, {1.5, 0.5, 0.5}, {3.5, 0.6, -0.4}, {5.5, 0.1, 0.2}}) {
        const Index j = Index(std::lround(10 * t));
        EXPECT_NEAR(r.x(j, 0), mirror * q, 1e-10) << t;
        EXPECT_NEAR(r.x(j, 1), mirror * v, 1e-10) << t;
      }
    }
}

// Two masses with Coulomb friction at the ground (y = (normal force, force along it beside -mu times that, excess
// speed)); x(10) and the impacts of an event-located reference with 1e-10.
TEST(Restitution, ImpactsWithFriction) {
  const double mu = 0.4, belt = 0.4;
  const Matrix K{{2, -0.6}, {-0.6, 1.5}}, C = 0.04 * Matrix::Identity(2, 2) + 0.01 * K;
  Matrix A = Matrix::Zero(4, 4), B = Matrix::Zero(4, 3), N = Matrix::Zero(3, 4);
  A.topRightCorner(2, 2).setIdentity();
  A.bottomLeftCorner(2, 2) = -K;
  A.bottomRightCorner(2, 2) = -C;
  B.col(0).tail(2) = Vector{{-mu, 1}};
  B(2, 1) = 1;
  N(0, 1) = 1;
  N(1, 2) = 1;
  for (const double e : {0.0, 0.5}) {
    Scene s;
    s.dynamics = DenseDynamics{A, B, N};
    s.M = Matrix{{0, 0, 0}, {0, 0, 1}, {2 * mu, -1, 0}};
    s.f = [](double t, Eigen::Ref<Vector> v) { v << 0, 0, 0.3 * std::sin(2.1 * t), -1 + 1.3 * std::cos(2.1 * t); };
    s.g = constant(Vector{{0, -belt, 0}});
    s.breakpoints_are_all = true;
    s.x0 = Vector::Zero(4);
    s.restitution = Vector{{e, 0, 0}};
    s.T = 10;
    const Result r = solved(s, 100);
    ASSERT_EQ(r.status, Status::solved) << e << ": " << r.reason;
    const Vector expected = e == 0 ? Vector{{-.2276458679, .0644897728, -.2264338204, -.5182400725}}
                                   : Vector{{-.2024374329, .0637274032, -.2157451367, -.5111438908}};
    for (Index i = 0; i < 4; ++i) EXPECT_NEAR(r.x(100, i), expected[i], 2e-9) << "e = " << e << ", state " << i;
  }
}

TEST(Restitution, RandomStructuresBounceAsTheExactFlow) {
  constexpr double T = 6;
  Index compared = 0;
  for (std::uint32_t seed = 1; seed <= 90; ++seed) {
    const Bouncing b(seed);
    const std::optional<Vector> expected = b.flown(T);
    if (!expected) continue;
    const Result r = solved(b.scene(T), 60);
    ASSERT_EQ(r.status, Status::solved) << "seed " << seed << ": " << r.reason;
    // Impacts magnify rounding, and a graze its square root: what the two integrations say of the error bounds it.
    const double error = (r.x.row(60).transpose() - *expected).cwiseAbs().maxCoeff();
    EXPECT_LE(error, 1e-7) << "seed " << seed << ", estimate " << r.error_estimate.value_or(NAN);
    ++compared;
  }
  EXPECT_GE(compared, 20);
}

TEST(Restitution, OtherUnitsBounceAlike) {
  const double length = 1e-6, time = 1e3;
  Scene s = ball(0.6, 2 * time, length);
  s.f = constant(Vector{{0, -gravity * length / (time * time)}});
  const Result r = solved(s, 100), plain = solved(ball(0.6, 2), 100);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  for (Index j = 0; j <= 100; ++j) EXPECT_NEAR(r.x(j, 0) / length, plain.x(j, 0), 1e-9);
}

TEST(Restitution, SoftImpactsAreThoseWithout) {
  Scene without = ball(0, 2);
  without.restitution.resize(0);
  const Result a = solved(ball(0, 2), 100), b = solved(without, 100, 1e-6);
  EXPECT_LE((a.x.bottomRows(1) - b.x.bottomRows(1)).cwiseAbs().maxCoeff(), 1e-9);
}

TEST(Restitution, OtherMethodsRefuse) {
  for (const Method m :
       {Method::euler, Method::dual, Method::contour, Method::multigrid, Method::galerkin, Method::shooting}) {
    Options o;
    o.method = m;
    o.steps = 50;
    const Result r = solve(ball(0.5, 1), *make_cpu_backend(1), o);
    EXPECT_EQ(r.status, Status::unsupported) << to_string(m);
    EXPECT_NE(r.reason.find("restitution"), std::string::npos) << r.reason;
  }
}

TEST(Restitution, BadValuesAreNamed) {
  Scene s = ball(0.5, 1);
  s.restitution = Vector{{0.5, 0.5}};
  EXPECT_EQ(refusal([&] { s.validate(); }), "restitution: has 2 entries; give 1, one per constraint");
  s.restitution = Vector{{1.5}};
  EXPECT_NE(refusal([&] { s.validate(); }).find("give 0 to 1"), std::string::npos);
  s.restitution = Vector{{0.5}};
  s.M = Matrix{{1}};
  EXPECT_NE(refusal([&] { s.validate(); }).find("rigid contact"), std::string::npos);
  s.M = Matrix{{0}};
  get<DenseDynamics>(s.dynamics).N = Matrix{{0, 1}};
  EXPECT_NE(refusal([&] { s.validate(); }).find("rigid contact"), std::string::npos);
}

}  // namespace
}  // namespace bromwich

// Impacts with restitution: the derivative of the flow against differences of exact flows, and periodic states.

#include "core/lcp/lcp_class.hpp"
#include "core/shooting/flow_derivative.hpp"
#include "tests/events/bouncing.hpp"
#include "tests/mechanics/mechanisms.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

EventSolution flow(const Scene& scene) {
  return integrate_with_events(scene, selection_class(scene.M, scene.lcp_class), scene.breakpoints, {});
}

// Central differences with two steps: what they differ by bounds their error, but for grazing.
TEST(FlowThroughImpacts, DerivativeIsThatOfTheExactFlow) {
  constexpr double T = 3, step = 2e-5;
  Index compared = 0;
  for (std::uint32_t seed = 1; seed <= 60; ++seed) {
    const Bouncing b(seed);
    const Index m = b.A.rows();
    const auto difference = [&](Index j, double h) -> std::optional<Vector> {
      const Vector change = h * Vector::Unit(m, j);
      const auto up = b.flown_from(b.x0 + change, T), down = b.flown_from(b.x0 - change, T);
      if (!up || !down) return std::nullopt;
      return Vector((*up - *down) / (2 * h));
    };
    if (!b.flown(T)) continue;
    const Scene scene = b.scene(T);
    const EventSolution s = flow(scene);
    ASSERT_TRUE(s.complete) << seed << ": " << s.reason;
    const Matrix D = FlowDerivative(scene).at_end(s);
    for (Index j = 0; j < m; ++j) {
      const auto fine = difference(j, step), coarse = difference(j, 2 * step);
      if (!fine || !coarse) continue;
      const double error = (*fine - *coarse).cwiseAbs().maxCoeff(), size = D.cwiseAbs().maxCoeff();
      if (error > 1e-3 * size) continue;  // an impact of one neighbour is none of the other
      EXPECT_LE((D.col(j) - *fine).cwiseAbs().maxCoeff(), error + 1e-6 * size) << "seed " << seed << ", state " << j;
      ++compared;
    }
  }
  EXPECT_GE(compared, 150);
}

/// x'' + 0.1 x' + x = cos 2 t, x >= -0.1, e = 0.8, over one period of the force. `side` = -1: its mirror image.
Mechanism impact_oscillator(double side) {
  Structure s = oscillator(
      0.1, 1, [side](double t) { return side * std::cos(2 * t); }, std::numbers::pi);
  s.periodic = true;
  Contact stop;
  stop.normal = Vector{{side}};
  stop.gap = always(0.1);
  stop.restitution = 0.8;
  return make_mechanism(s, {stop});
}

TEST(ShootingWithImpacts, TheImpactOscillatorIsPeriodic) {
  for (const double side : {1.0, -1.0}) {
    const Result r = located(impact_oscillator(side).scene);
    ASSERT_EQ(r.method, Method::shooting);
    // The tolerance of steps is 1e-10 of the states, of which these 32 steps may add all, and (I - D)^{-1} is below 2.
    EXPECT_NEAR(side * r.start[0], 1.7906608509, 1e-8);
    EXPECT_NEAR(side * r.start[1], 2.6882856471, 1e-8);
    EXPECT_LE((last_state(r) - r.start).cwiseAbs().maxCoeff(), 1e-8);
    // The flow contracts areas by exp(-0.1 t), and an impact at a stop that rests by e^2.
    ASSERT_EQ(r.multipliers.size(), 2u);
    const Complex product = r.multipliers[0] * r.multipliers[1];
    EXPECT_NEAR(product.real(), 0.64 * std::exp(-0.1 * std::numbers::pi), 1e-8);
    EXPECT_NEAR(product.imag(), 0, 1e-10);
  }
}

// x1' = -x1 + y, x2' = -x2 + x1 + 2 y, 0 <= y, x1 >= 1 - t: g jumps where a period ends, and x with it, by (p, 2 p).
// Behind it x1 = e^{-t}, x2 = (x2(0) + 2 p + t) e^{-t}, so that p = 1 - 1 / e and x2(0) = (2 p + 1) / (e - 1).
TEST(ShootingWithImpulses, OneWhereThePeriodEnds) {
  constexpr double e = std::numbers::e, p = 1 - 1 / e;
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1, 0}, {1, -1}}, Matrix{{1}, {2}}, Matrix{{1, 0}}};
  scene.M = Matrix{{0}};
  scene.g = [](double t, Eigen::Ref<Vector> g) { g[0] = t - 1; };
  scene.T = 1;
  scene.boundary = BoundaryCondition{Matrix::Identity(2, 2), -Matrix::Identity(2, 2), Vector::Zero(2)};
  for (const bool tolerance : {false, true}) {
    Options options = options_for(Method::shooting, 50);
    options.states = StateSelection::all;
    if (tolerance) options.steps = 0, options.tolerance = 1e-8;
    const Result r = run(scene, options);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    const Vector start{{1 / e, (2 * p + 1) / (e - 1)}};
    EXPECT_LE((r.start - start).cwiseAbs().maxCoeff(), 1e-8);
    EXPECT_LE((r.x.bottomRows(1).transpose() - start).cwiseAbs().maxCoeff(), 1e-8);
    EXPECT_LE((r.x.topRows(1).transpose() - start).cwiseAbs().maxCoeff(), 1e-8);
    EXPECT_TRUE(r.starts_with_impulse);
    EXPECT_NEAR(r.y_integral.bottomRows(1)(0), p, 1e-8);
  }
}

// Where periodic states of masses that bounce are found, the exact flow says so too.
TEST(ShootingWithImpacts, RandomStructuresReturnByTheExactFlow) {
  constexpr double T = std::numbers::pi;
  Index found = 0;
  for (std::uint32_t seed = 1; seed <= 30; ++seed) {
    Bouncing b(seed);
    const Index k = b.k(), m = 2 * k;
    Scene scene = b.scene(T);
    const Matrix A = b.A.topLeftCorner(m, m), F = b.A.topRightCorner(m, 2);  // cos and sin as f
    DenseDynamics& d = get<DenseDynamics>(scene.dynamics);
    d = DenseDynamics{A, Matrix(d.B.topRows(m)), Matrix(d.N.leftCols(m))};
    scene.f = [F](double t, Eigen::Ref<Vector> f) { f = F * Vector{{std::cos(2 * t), std::sin(2 * t)}}; };
    scene.x0 = {};
    scene.boundary = BoundaryCondition{Matrix::Identity(m, m), -Matrix::Identity(m, m), Vector::Zero(m)};
    Options options = options_for(Method::shooting, 50);
    options.states = StateSelection::all;
    const Result r = run(scene, options);
    if (r.status != Status::solved) continue;
    Vector start(m + 2);
    start << r.start, 1, 0;
    const auto end = b.flown_from(start, T);
    if (!end) continue;
    EXPECT_LE((end->head(m) - r.start).cwiseAbs().maxCoeff(), 1e-7) << seed;
    ++found;
  }
  EXPECT_GE(found, 10);
}

}  // namespace
}  // namespace bromwich

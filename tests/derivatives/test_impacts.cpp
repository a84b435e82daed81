// Derivatives through impacts with restitution, and where contacts come to stick, by the coefficients of restitution
// and friction too: against differences of exact flows and of located solutions, and the transpose.

#include "cpu/cpu_backend.hpp"
#include "derivatives/parameter_derivative.hpp"
#include "derivatives/switched_derivative.hpp"
#include "tests/events/bouncing.hpp"
#include "tests/mechanics/contact_flow.hpp"
#include "tests/mechanics/mechanisms.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

constexpr double T = 3;
const Vector times{{0, 1, 2, 3}};

Matrix drawn(Index rows, Index cols, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> in(-1, 1);
  Matrix a(rows, cols);
  for (double& value : a.reshaped()) value = in(random);
  return a;
}

// The changes of x(T) by the start, by floors, by the dynamics and by the restitution of masses that bounce.
TEST(DerivativesThroughImpacts, AreThoseOfTheExactFlow) {
  constexpr double step = 2e-5;
  Index compared = 0;
  for (std::uint32_t seed = 1; seed <= 60; ++seed) {
    const Bouncing b(seed);
    if (!b.flown(T)) continue;
    const Index m = b.A.rows(), k = b.k();
    Matrix by_A = Matrix::Zero(m, m);
    by_A.block(k, 0, k, 2 * k) = drawn(k, 2 * k, seed);
    DataChange start, floors, dynamics, bounces;
    start.x0 = drawn(m, 1, seed + 1000);
    floors.g = RowMatrix::Ones(times.size(), k);
    dynamics.A = by_A;
    bounces.restitution = drawn(k, 1, seed + 2000);
    const auto changed = [&](const DataChange& c, double h) {
      Bouncing other = b;
      if (c.x0.size() > 0) other.x0 += h * c.x0;
      if (c.g.size() > 0) other.floor.array() -= h;
      if (c.A.size() > 0) other.A += h * c.A;
      if (c.restitution.size() > 0) other.e += h * c.restitution;
      return other.flown(T);
    };
    std::optional<SwitchedDerivative> derivative;
    try {
      derivative.emplace(b.scene(T), times);
    } catch (const Error&) {
      continue;  // impacts at once, or one that only touches
    }
    for (const DataChange* c : {&start, &floors, &dynamics, &bounces}) {
      const auto difference = [&](double h) -> std::optional<Vector> {
        const auto up = changed(*c, h), down = changed(*c, -h);
        if (!up || !down) return std::nullopt;
        return Vector((*up - *down) / (2 * h));
      };
      const auto fine = difference(step), coarse = difference(2 * step);
      if (!fine || !coarse) continue;
      const Vector found = derivative->jvp(*c).x.bottomRows(1).transpose();
      const double error = (*fine - *coarse).cwiseAbs().maxCoeff(), size = 1 + found.cwiseAbs().maxCoeff();
      if (error > 1e-3 * size) continue;
      EXPECT_LE((found - *fine).cwiseAbs().maxCoeff(), error + 1e-6 * size) << "seed " << seed << ", change "
                                                                            << (c == &start      ? "x0"
                                                                                : c == &floors   ? "g"
                                                                                : c == &dynamics ? "A"
                                                                                                 : "e");
      ++compared;
    }
  }
  EXPECT_GE(compared, 80);
}

double dot(const RowMatrix& a, const RowMatrix& b) { return a.cwiseProduct(b).sum(); }

TEST(DerivativesThroughImpacts, GradientIsTheTranspose) {
  Index compared = 0;
  for (std::uint32_t seed = 1; seed <= 20; ++seed) {
    const Bouncing b(seed);
    const Index m = b.A.rows(), k = b.k();
    std::optional<SwitchedDerivative> d;
    try {
      d.emplace(b.scene(T), times);
    } catch (const Error&) {
      continue;
    }
    DataChange c;
    c.x0 = drawn(m, 1, seed);
    c.f = drawn(times.size(), m, seed + 1), c.f.leftCols(k).setZero();
    c.g = drawn(times.size(), k, seed + 2);
    c.A = Matrix::Zero(m, m), c.A.block(k, 0, k, m) = drawn(k, m, seed + 3);
    c.restitution = drawn(k, 1, seed + 6);
    SolutionChange of;
    of.x = drawn(times.size(), m, seed + 4);
    of.integral = drawn(times.size(), k, seed + 5);
    const SolutionChange out = d->jvp(c);
    const DataChange bar = d->vjp(of);
    const double left = dot(of.x, out.x) + dot(of.integral, out.integral);
    const double right = c.x0.dot(bar.x0) + dot(c.f, bar.f) + dot(c.g, bar.g) + c.A.cwiseProduct(bar.A).sum() +
                         c.restitution.dot(bar.restitution);
    EXPECT_NEAR(left, right, 1e-9 * (std::abs(left) + of.x.cwiseAbs().sum() * out.x.cwiseAbs().maxCoeff())) << seed;
    ++compared;
  }
  EXPECT_GE(compared, 10);
}

// A block on a belt that lifts off, bounces with friction and sticks: by the force along the belt and by x(0).
TEST(DerivativesThroughImpacts, WithFrictionAreDifferences) {
  constexpr double step = 1e-5;
  for (const double e : {0.0, 0.5}) {
    const auto belted = [e](double pull, double place) {
      Structure s = block(1.3, 1.2);
      s.f = forces([pull, f = s.f](double t) {
        Vector value(2);
        f(t, value);
        value[0] += pull;
        return value;
      });
      s.q0 = Vector{{place, 0.05}};
      return make_mechanism(s, {belt(e)}).scene;
    };
    const auto end = [](const Scene& scene) { return last_state(located(scene)); };
    // The friction of an open contact is zero, and so is what bounds it: changes have to keep that.
    const SwitchedDerivative d(belted(0, 0), Vector{{0, 0.6, 1.2}}, true);
    EXPECT_FALSE(d.switches().empty());
    DataChange pulled, moved;
    pulled.f = RowMatrix::Zero(3, 4), pulled.f.col(2).setOnes();
    moved.x0 = Vector::Unit(4, 0);
    const Vector by_pull = (end(belted(step, 0)) - end(belted(-step, 0))) / (2 * step),
                 by_place = (end(belted(0, step)) - end(belted(0, -step))) / (2 * step);
    EXPECT_LE((d.jvp(pulled).x.bottomRows(1).transpose() - by_pull).cwiseAbs().maxCoeff(), 1e-5) << e;
    EXPECT_LE((d.jvp(moved).x.bottomRows(1).transpose() - by_place).cwiseAbs().maxCoeff(), 1e-5) << e;
  }
}

// The state of a block on a belt behind its second impact by mu and e of its contact: against differences of located
// events that share no code with the solver, whose errors of 1e-9 the step divides.
TEST(DerivativesThroughImpacts, ByTheCoefficientsOfAContact) {
  constexpr double step = 1e-4, e = 0.5, mu = 0.4;
  const auto belted = [](double mu, double e) {
    Structure s = block(1.3, 1.22);
    s.q0 = Vector{{0, 0.05}};
    Contact c = belt(e);
    c.mu = mu;
    return make_mechanism(s, {c});
  };
  const auto end = [&](double mu, double e) {
    const oracle::ContactFlow flow = oracle::contact_flow(belted(mu, e), 1, 5e-4);
    EXPECT_TRUE(flow.decided) << flow.reason;
    return Vector((Vector(4) << flow.q[0], flow.v[0]).finished());
  };
  Result result = located(belted(mu, e).scene);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  const std::vector<VariedParameter> parameters{{"mu", mu,
                                                 [&](double value) {
                                                   return ParameterScene{belted(value, e).scene, nullptr};
                                                 }},
                                                {"e", e, [&](double value) {
                                                   return ParameterScene{belted(mu, value).scene, nullptr};
                                                 }}};
  const auto backend = make_cpu_backend(1);
  const ParameterDerivative d(belted(mu, e).scene, result, *backend, parameters, true);
  EXPECT_FALSE(d.of_data().switched()->switches().empty());
  const Vector by_mu = (end(mu + step, e) - end(mu - step, e)) / (2 * step),
               by_e = (end(mu, e + step) - end(mu, e - step)) / (2 * step);
  EXPECT_GE(by_mu.cwiseAbs().maxCoeff(), 0.01);
  EXPECT_GE(by_e.cwiseAbs().maxCoeff(), 0.01);
  EXPECT_LE((d.jvp(0).x.bottomRows(1).transpose() - by_mu).cwiseAbs().maxCoeff(), 1e-4);
  EXPECT_LE((d.jvp(1).x.bottomRows(1).transpose() - by_e).cwiseAbs().maxCoeff(), 1e-4);
}

// Without rebound a change of e makes bounces that begin there.
TEST(DerivativesThroughImpacts, NotByARestitutionOfZero) {
  Structure s = block(1.3, 1.2);
  s.q0 = Vector{{0, 0.05}};
  const SwitchedDerivative d(make_mechanism(s, {belt(0)}).scene, Vector{{0, 1.2}}, true);
  DataChange bounces;
  bounces.restitution = Vector::Unit(3, 0);
  EXPECT_THROW(d.jvp(bounces), Error);
}

}  // namespace
}  // namespace bromwich

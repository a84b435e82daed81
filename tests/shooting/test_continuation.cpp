// Branches of periodic states against closed forms: linear structures, period-one orbits of an impact oscillator; and
// against long transients.

#include "bromwich/continuation.hpp"
#include "tests/mechanics/mechanisms.hpp"

#include <gtest/gtest.h>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

namespace bromwich::continuation_test {
namespace {

using std::numbers::pi;

const BranchMark* find(const Branch& b, BranchEvent event, Index which = 0) {
  for (const BranchMark& m : b.marks)
    if (m.event == event && which-- == 0) return &m;
  return nullptr;
}

/// x'' + c x' + k x = cos w t of one coordinate: its e^{At}, and its response, whose complex amplitude this is.
struct Oscillator {
  double c = 0.1, k = 1;

  Complex response(double w) const { return 1.0 / Complex(k - w * w, c * w); }
  Matrix flow(double t) const {
    const double d = c / 2, r = std::sqrt(k - d * d), S = std::sin(r * t) / r, C = std::cos(r * t);
    return std::exp(-d * t) * Matrix{{C + d * S, S}, {-k * S, C - d * S}};
  }
  /// (x, v) of the response at t.
  Vector at(double w, double t) const {
    const Complex u = response(w) * std::polar(1.0, w * t);
    return Vector{{u.real(), -w * u.imag()}};
  }
};

Scene forced(double c, double w, const std::vector<Contact>& contacts) {
  Structure s = oscillator(
      c, 1, [w](double t) { return std::cos(w * t); }, 2 * pi / w);
  s.periodic = true;
  return make_mechanism(s, contacts).scene;
}

TEST(Continuation, FollowsTheResponseOfALinearStructure) {
  const Oscillator o;
  const Branch b = continuation([](double w) { return forced(0.1, w, {}); }, 0.2, 3);
  ASSERT_TRUE(b.complete) << b.reason;
  EXPECT_TRUE(b.marks.empty());
  EXPECT_GE(b.points.size(), 100u);
  EXPECT_EQ(b.points.front().parameter, 0.2);
  EXPECT_EQ(b.points.back().parameter, 3);
  for (const BranchPoint& p : b.points) {
    // Steps of 1e-9 of the states, 16 a period, and (I - D)^{-1} below 10: 2e-7.
    const double size = std::abs(o.response(p.parameter));
    EXPECT_LE((p.x0 - o.at(p.parameter, 0)).norm(), 2e-7 * size);
    EXPECT_NEAR(p.largest[0], size, 1e-6 * size);
    EXPECT_NEAR(p.least[0], -size, 1e-6 * size);
    EXPECT_TRUE(p.stable);
    EXPECT_NEAR(std::abs(p.multipliers[0]), std::exp(-0.05 * p.T), 1e-8);
  }
}

/// x >= -1, with restitution e: orbits with one impact a period. From an impact on, x = response + e^{At} d with
/// d = v k, v the velocity after it, since (I - e^{AT}) d = (0, (1 + 1/e) v). Where the response is on the circle of
/// its amplitude, v solves a quadratic equation (Shaw & Holmes 1983).
struct OneImpact {
  static constexpr double e = 0.8;
  Oscillator o = {};

  Vector k(double w) const { return (Matrix::Identity(2, 2) - o.flow(2 * pi / w)).inverse() * Vector{{0, 1 + 1 / e}}; }
  /// Of a v^2 + 2 b v + c = 0.
  Vector coefficients(double w) const {
    const Vector d = k(w);
    return Vector{{d[0] * d[0] + std::pow((1 - d[1]) / w, 2), d[0], 1 - std::norm(o.response(w))}};
  }
  double discriminant(double w) const {
    const Vector a = coefficients(w);
    return a[1] * a[1] - a[0] * a[2];
  }
  double fold() const {
    double low = 1.7, high = 1.8;
    while (high - low > 1e-14) (discriminant((low + high) / 2) > 0 ? low : high) = (low + high) / 2;
    return low;
  }
  /// Where the response touches the stop.
  double grazing() const {
    double low = 1, high = 2;
    while (high - low > 1e-14) (std::abs(o.response((low + high) / 2)) > 1 ? low : high) = (low + high) / 2;
    return low;
  }
  struct Orbit {
    Vector x0;
    Complex trace, determinant;
  };
  /// The faster one, or the slower one.
  Orbit orbit(double w, bool fast) const {
    const Vector a = coefficients(w), d = k(w);
    const double v = (-a[1] + (fast ? 1 : -1) * std::sqrt(discriminant(w))) / a[0], T = 2 * pi / w;
    const Complex response(-1 - v * d[0], -(v - v * d[1]) / w);
    const double phase = std::arg(response / o.response(w)), begin = std::fmod(phase + 2 * pi, 2 * pi) / w;
    const double force = std::cos(phase), before = force + 1 + o.c * v / e, after = force + 1 - o.c * v;
    const Matrix impact{{-e, 0}, {-(after + e * before) / (v / e), -e}}, D = impact * o.flow(T);
    return {o.at(w, T) + o.flow(T - begin) * (v * d), D.trace(), D.determinant()};
  }
};

Scene impact_oscillator(double w) {
  Contact stop;
  stop.normal = Vector{{1}};
  stop.gap = always(1);
  stop.restitution = OneImpact::e;
  return forced(0.1, w, {stop});
}

// The branch: stable impacts up to the fold, unstable ones back to where they graze, and from there free motion.
void expect_the_branch(const Branch& b) {
  const OneImpact exact;
  ASSERT_TRUE(b.complete) << b.reason;
  const BranchMark *smooth = find(b, BranchEvent::fold, 0), *corner = find(b, BranchEvent::fold, 1),
                   *grazing = find(b, BranchEvent::grazing);
  ASSERT_TRUE(smooth && corner && grazing);
  EXPECT_EQ(b.marks.size(), 3u);
  if (smooth->parameter < corner->parameter) std::swap(smooth, corner);
  // p is stationary at the fold, and is located to 1e-6 of a step of the interval elsewhere.
  EXPECT_NEAR(smooth->parameter, exact.fold(), 1e-8);
  EXPECT_NEAR(grazing->parameter, exact.grazing(), 1e-5);
  EXPECT_NEAR(corner->parameter, exact.grazing(), 1e-5);
  EXPECT_EQ(grazing->component, 0);
  Index fast = 0, slow = 0, free = 0;
  for (const BranchPoint& p : b.points) {
    if (p.impacts == 0) {
      EXPECT_LE((p.x0 - exact.o.at(p.parameter, 0)).norm(), 1e-6);
      ++free;
      continue;
    }
    ASSERT_EQ(p.impacts, 1) << p.parameter;
    const auto here = exact.orbit(p.parameter, p.stable);
    EXPECT_LE((p.x0 - here.x0).norm(), 1e-5) << p.parameter << p.stable;
    ++(p.stable ? fast : slow);
    if (here.trace.real() > 10) continue;  // near grazing all changes grow
    EXPECT_NEAR(std::abs(p.multipliers[0] + p.multipliers[1] - here.trace), 0, 1e-3);
    EXPECT_NEAR(std::abs(p.multipliers[0] * p.multipliers[1] - here.determinant), 0, 1e-6);
  }
  EXPECT_GE(fast, 20);
  EXPECT_GE(slow, 20);
  EXPECT_GE(free, 50);
}

TEST(Continuation, PassesTheFoldAndTheGrazingOfAnImpactOscillator) {
  expect_the_branch(continuation(impact_oscillator, 1.2, 3));
}

TEST(Continuation, PassesThemFromTheOtherEnd) { expect_the_branch(continuation(impact_oscillator, 3, 1.2)); }

/// A Jenkins element of stiffness 0.5 between a mass and a frame, with the bound 0.5.
Contact jenkins(const Matrix& tangent) {
  Contact c;
  c.tangent = tangent;
  c.bound = always(0.5);
  c.kt = 0.5;
  return c;
}

// Where the element sticks the structure is linear, with the stiffness 1.5. It slips between the frequencies at which
// 0.5 |x| = 0.5.
TEST(Continuation, FindsWhereAJenkinsElementBeginsToSlip) {
  const double c = 0.1;
  const Oscillator stuck{c, 1.5};
  const Branch b = continuation([&](double w) { return forced(c, w, {jenkins(Matrix{{1}})}); }, 0.3, 2);
  ASSERT_TRUE(b.complete) << b.reason;
  ASSERT_EQ(b.marks.size(), 2u);
  for (const BranchMark& m : b.marks) {
    EXPECT_EQ(m.event, BranchEvent::grazing);
    // Located to 1e-6 of the interval, |x| changes by less than 5 in it.
    EXPECT_NEAR(std::abs(stuck.response(m.parameter)), 1, 2e-5);
  }
  Index sticks = 0;
  for (const BranchPoint& p : b.points) {
    EXPECT_TRUE(p.stable);
    const double size = std::abs(stuck.response(p.parameter)), found = (p.largest[0] - p.least[0]) / 2;
    if (p.parameter < b.marks[0].parameter || p.parameter > b.marks[1].parameter) {
      EXPECT_NEAR(found, size, 1e-6 * size) << p.parameter;
      ++sticks;
    } else {
      EXPECT_GE(p.largest[2] - p.least[2], 1 - 1e-6);  // the force goes from one bound to the other
    }
  }
  EXPECT_GE(sticks, 30);
}

/// Two masses between three springs, each with an element to the frame.
Scene two_elements(double w) {
  const Matrix K{{2, -1}, {-1, 2}};
  Structure s;
  s.M = sparse(Matrix::Identity(2, 2)), s.K = sparse(K), s.C = sparse(0.03 * K);
  s.f = forces([w](double t) { return Vector{{0.6 * std::cos(w * t), 0.2 * std::sin(w * t)}}; });
  s.T = 2 * pi / w;
  s.breakpoints_are_all = true;
  s.periodic = true;
  return make_mechanism(s, {jenkins(Matrix{{1, 0}}), jenkins(Matrix{{0, 1}})}).scene;
}

/// x(T) of the same by small steps: the implicit midpoint rule, with forces of the elements cut at their bounds.
Vector stepped(double w, const Vector& x0, int steps) {
  const Matrix K{{2, -1}, {-1, 2}}, C = 0.03 * K;
  const double h = 2 * pi / w / steps;
  Vector q = x0.head(2), v = x0.segment(2, 2), force = x0.tail(2);
  for (int k = 0; k < steps; ++k) {
    const double t = (k + 0.5) * h;
    const Vector f{{0.6 * std::cos(w * t), 0.2 * std::sin(w * t)}};
    Vector v_end = v, mean_force = force;
    for (int pass = 0; pass < 30; ++pass) {
      const Vector mean = (v + v_end) / 2;
      const Vector end = (force + 0.5 * h * mean).cwiseMax(-0.5).cwiseMin(0.5);
      mean_force = (force + end) / 2;
      v_end = v + h * (f - C * mean - K * (q + h / 2 * mean) - mean_force);
    }
    const Vector mean = (v + v_end) / 2;
    force = (force + 0.5 * h * mean).cwiseMax(-0.5).cwiseMin(0.5);
    q += h * mean;
    v = v_end;
  }
  Vector x(6);
  x << q, v, force;
  return x;
}

TEST(Continuation, FrequencyResponseOfTwoJenkinsElementsReturnsByTimeStepping) {
  ContinuationOptions options;
  options.longest_step = 0.006;
  const Branch b = continuation(two_elements, 0.5, 2.5, options);
  ASSERT_TRUE(b.complete) << b.reason;
  EXPECT_GE(b.points.size(), 200u);
  EXPECT_GE(b.marks.size(), 4u);
  for (std::size_t k = 0; k < b.points.size(); k += 10) {
    const BranchPoint& p = b.points[k];
    // What the coarse and the fine steps differ by bounds the error of the fine ones.
    const Vector fine = stepped(p.parameter, p.x0, 4000), coarse = stepped(p.parameter, p.x0, 2000);
    EXPECT_LE((fine - p.x0).norm(), (fine - coarse).norm() + 1e-6) << p.parameter;
    EXPECT_TRUE(p.stable);
  }
}

// On both sides of the fold of the impact oscillator motion is followed for a long time: it stays with impacts before,
// and comes to the free motion behind.
TEST(Continuation, LongTransientsAgreeOnBothSidesOfAFold) {
  const Branch b = continuation(impact_oscillator, 1.2, 3);
  const BranchMark* fold = find(b, BranchEvent::fold);
  ASSERT_TRUE(fold);
  for (const double side : {-1.0, 1.0}) {
    const double w = fold->parameter + 2e-3 * side;
    Scene scene = impact_oscillator(w);
    scene.boundary.reset();
    scene.x0 = fold->x0;
    scene.T *= 300;
    Options options = options_for(Method::events, 300);
    options.states = StateSelection::all;
    const Result r = run(scene, options);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    const OneImpact exact;
    const Vector expected = side < 0 ? exact.orbit(w, true).x0 : exact.o.at(w, 0);
    EXPECT_LE((last_state(r) - expected).norm(), 1e-3) << w;
  }
}

TEST(Continuation, SaysWhatIsWrong) {
  EXPECT_THROW(continuation(impact_oscillator, 1, 1), Error);
  EXPECT_THROW(continuation([](double) { return impact_oscillator(1); }, 1, NAN), Error);
  const auto started = [](double w) {
    Scene scene = impact_oscillator(w);
    scene.boundary.reset();
    scene.x0 = Vector::Zero(2);
    return scene;
  };
  EXPECT_THROW(continuation(started, 1, 2), Error);
}

}  // namespace
}  // namespace bromwich::continuation_test

// Contacts with friction by located events, against numbers of an event-located exact flow that shares no code with the
// library (energy balance to 1e-11), and in mirrors.

#include "core/events/event_driven.hpp"
#include "tests/support/friction.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

namespace bromwich {
namespace {

using oracle::Contacts;
using oracle::friction_scene;
using oracle::mirrored;

constexpr double accurate = 1e-8;  ///< a hundred times EventOptions::tolerance: the references have ten digits

// A body with an oblique mass matrix strikes the ground and slips on.
Contacts oblique() {
  Contacts c;
  c.mass = Matrix{{2, -1}, {-1, 2}};
  c.damping = c.stiffness = Matrix::Zero(2, 2);
  c.Hn = Matrix{{0, 1}};
  c.Ht = Matrix{{1, 0}};
  c.V = Vector{{0}};
  c.mu = Vector{{0.3}};
  c.x0 = Vector{{0, 0.1, -1, -1}};
  c.f = [](double) { return Vector{{0, -1}}; };
  return c;
}

// A block on a belt of velocity 0.4 under a load that varies by `load`; it lifts off for 1.3.
Contacts on_a_belt(double load, double T) {
  Contacts c;
  c.mass = Matrix::Identity(2, 2);
  c.stiffness = Matrix{{2, -0.6}, {-0.6, 1.5}};
  c.damping = 0.04 * c.mass + 0.01 * c.stiffness;
  c.Hn = Matrix{{0, 1}};
  c.Ht = Matrix{{1, 0}};
  c.V = Vector{{0.4}};
  c.mu = Vector{{0.4}};
  c.x0 = Vector::Zero(4);
  c.T = T;
  c.f = [load](double t) { return Vector{{0.3 * std::sin(2.1 * t), -1 + load * std::cos(2.1 * t)}}; };
  return c;
}

EventSolution events_of(const Scene& scene) { return integrate_with_events(scene, LcpClass::unknown, {}, {}); }

void expect_x(const EventSolution& s, double t, const Vector& x) {
  ASSERT_TRUE(s.complete) << s.reason;
  EXPECT_LE((s.x(t, true) - x).cwiseAbs().maxCoeff(), accurate) << s.x(t, true).transpose();
}

TEST(Friction, AnImpactHasAnImpulseAgainstTheSlip) {
  const EventSolution s = events_of(friction_scene(oblique()));
  expect_x(s, 1, Vector{{-0.3086956522, 0, -0.1739130435, 0}});
  ASSERT_EQ(s.jumps, 1);
  for (const EventPiece& p : s.pieces) {
    if (p.impulses.empty()) continue;
    EXPECT_NEAR(p.begin, 0.096871942, accurate);
    EXPECT_NEAR(p.impulses[0].p[0], 1.3885843, 1e-7);  // the reference has eight digits
    EXPECT_NEAR(p.impulses[0].p[1] - 0.3 * p.impulses[0].p[0], 0.416575289, 1e-7);
  }
}

TEST(Friction, ABlockOnABelt) {
  const EventSolution s = events_of(friction_scene(on_a_belt(0.6, 20)));
  expect_x(s, 20, Vector{{0.3061912019, 0, 0.3000815285, 0}});
  const Vector sum = s.integral_of_y(20, true);
  EXPECT_NEAR(sum[0], 18.3080252654, 20 * accurate);
  EXPECT_NEAR(sum[1] - 0.4 * sum[0], 6.6251247212, 20 * accurate);
}

TEST(Friction, ABlockThatLiftsOffABelt) {
  const EventSolution s = events_of(friction_scene(on_a_belt(1.3, 10)));
  expect_x(s, 10, Vector{{-0.2276458679, 0.0644897728, -0.2264338204, -0.5182400725}});
  EXPECT_EQ(s.jumps, 3);
}

TEST(Friction, MirrorsGiveMirrorImages) {
  for (const Contacts& c : {oblique(), on_a_belt(0.6, 20), on_a_belt(1.3, 10)}) {
    const EventSolution s = events_of(friction_scene(c)), mirror = events_of(friction_scene(mirrored(c)));
    ASSERT_TRUE(s.complete) << s.reason;
    const Vector sign{{-1, 1, -1, 1}};
    for (const double part : {0.2, 0.5, 0.7, 1.0})
      expect_x(mirror, part * c.T, sign.cwiseProduct(s.x(part * c.T, true)));
  }
}

// Two bodies that strike the ground at different times, with their contacts in any order.
TEST(Friction, TheOrderOfContactsIsNoMatter) {
  const Contacts one = oblique();
  Contacts two;
  two.mass = two.damping = two.stiffness = Matrix::Zero(4, 4);
  two.mass.topLeftCorner(2, 2) = one.mass;
  two.mass.bottomRightCorner(2, 2) = mirrored(one).mass;
  two.V = Vector::Zero(2);
  two.mu = Vector::Constant(2, 0.3);
  two.x0 = Vector{{0, 0.1, 0, 0.2, -1, -1, 1, -1}};
  two.f = [](double) { return Vector{{0, -1, 0, -1}}; };
  // The second one falls 0.2 with the acceleration 2/3 from the velocity 1; its tangential motion is mirrored.
  Contacts later = mirrored(one);
  later.x0 = Vector{{0, 0.2, 1, -1}};
  const EventSolution first = events_of(friction_scene(one)), second = events_of(friction_scene(later));
  ASSERT_TRUE(second.complete) << second.reason;
  for (const bool swapped : {false, true}) {
    two.Hn = swapped ? Matrix{{0, 0, 0, 1}, {0, 1, 0, 0}} : Matrix{{0, 1, 0, 0}, {0, 0, 0, 1}};
    two.Ht = swapped ? Matrix{{0, 0, -1, 0}, {1, 0, 0, 0}} : Matrix{{1, 0, 0, 0}, {0, 0, -1, 0}};
    Vector x(8);
    x << first.x(1, true).head(2), second.x(1, true).head(2), first.x(1, true).tail(2), second.x(1, true).tail(2);
    expect_x(events_of(friction_scene(two)), 1, x);
  }
}

// A mass at rest on a stop with dry friction 1, pushed towards it by 1/2: the force of the stop is not unique, q = 0
// is.
TEST(Friction, AtRestOnAStop) {
  Scene scene;
  scene.dynamics =
      DenseDynamics{Matrix{{0, 1}, {0, 0}}, Matrix{{0, 0, 0}, {1, -1, 0}}, Matrix{{1, 0}, {0, -1}, {0, 0}}};
  scene.M = Matrix{{0, 0, 0}, {0, 0, 1}, {0, -1, 0}};
  scene.f = [](double, Eigen::Ref<Vector> v) { v << 0, 1.5; };
  scene.g = [](double, Eigen::Ref<Vector> v) { v << 0, 0, 2; };
  scene.x0 = Vector::Zero(2);
  scene.T = 3;
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  EXPECT_LE(s.x(3, true).norm(), 1e-12);
  EXPECT_NEAR(s.y(3, true)[1] - s.y(3, true)[0], 1.5, 1e-9);
  EXPECT_NEAR(s.y(3, true)[0], 0, 1e-9) << "of least norm";
}

// Three tanks in a row, each between 0 and 2, spill into the next. All fill up at rates of their own: the first reaches
// 2 when x1' = 1 - x1 / 5 stops, and so on. With s = e^{-t/5} and no spill: x1 = 5 - 4 s, 2 at s = 3/4; then the first
// spills 1 - 2/5.
TEST(Friction, TanksThatSpillIntoTheNext) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-0.2, 0, 0}, {0.2, -0.2, 0}, {0, 0.2, -0.2}},
                                 Matrix{{1, 0, 0, -1, 0, 0}, {0, 1, 0, 1, -1, 0}, {0, 0, 1, 0, 1, -1}},
                                 Matrix{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {-1, 0, 0}, {0, -1, 0}, {0, 0, -1}}};
  scene.M = Matrix(Matrix::Zero(6, 6));
  scene.f = [](double, Eigen::Ref<Vector> v) { v << 1, 0, 0; };
  scene.g = [](double, Eigen::Ref<Vector> v) { v << 0, 0, 0, 2, 2, 2; };
  scene.x0 = Vector::Ones(3);
  scene.T = 30;
  for (const double unit : {1.0, 1e-6, 1e5}) {
    Scene scaled = scene;
    DenseDynamics d = get<DenseDynamics>(scene.dynamics);
    d.N.bottomRows(3) *= unit;
    d.B.col(4) *= unit;
    scaled.dynamics = d;
    scaled.g = [unit](double, Eigen::Ref<Vector> v) { v << 0, 0, 0, 2 * unit, 2 * unit, 2 * unit; };
    const EventSolution s = integrate_with_events(scaled, LcpClass::PSD, {}, {});
    ASSERT_TRUE(s.complete) << s.reason;
    const double full = -5 * std::log(0.75);
    EXPECT_NEAR(s.x(full / 2, true)[0], 5 - 4 * std::exp(-full / 10), accurate);
    EXPECT_NEAR(s.x(full + 0.1, true)[0], 2, accurate);
    EXPECT_NEAR(s.y(full + 0.1, true)[3], 0.6, accurate);
    EXPECT_NEAR((s.x(30, true) - Vector::Constant(3, 2)).norm(), 0, accurate);
    EXPECT_NEAR(s.y(30, true)[5], 0.6, accurate) << "what flows in, less what flows out of the last one";
  }
}

}  // namespace
}  // namespace bromwich

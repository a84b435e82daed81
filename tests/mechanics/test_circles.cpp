// Friction on circles by march: reference digits of a located flow, planar contacts, facets, and impacts by hand.

#include "tests/mechanics/mechanisms.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

// A mass on a plane that is pressed on by N(t), with springs along both axes.
Mechanism pressed(Index facets, double turned = 0) {
  Structure s;
  s.M = sparse(Matrix::Identity(2, 2)), s.K = sparse(Matrix{{4, 0}, {0, 9}});
  s.f = forces([](double t) { return Vector{{1.5 * std::sin(3 * t) + 0.5, 1.2 * std::cos(2 * t)}}; });
  s.q0 = Vector{{0.5, 0.8}}, s.v0 = Vector{{2, 0}};
  s.T = 4;
  s.breakpoints_are_all = true;
  Contact c;
  c.tangent = Matrix{{std::cos(turned), std::sin(turned)}, {-std::sin(turned), std::cos(turned)}};
  c.bound = of_time([](double t) { return 0.2 * (9.81 + 4 * std::cos(7 * t)); });
  c.facets = facets;
  return make_mechanism(s, {c});
}

const Vector exact{{0.0290263945, 0.097645178}};

Result stepped(const Mechanism& m, Index steps) {
  Options options = marched(steps);
  options.confirm = false;
  Result r = run(m.scene, options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  return r;
}

Vector positions(const Mechanism& m, Index steps) { return last_state(stepped(m, steps)).head(m.coordinates()); }

double error_of(const Mechanism& m, Index steps) { return (positions(m, steps) - exact).cwiseAbs().maxCoeff(); }

// With what the reference has of digits.
TEST(Circles, AMassThatComesToRest) {
  const Mechanism m = pressed(0);
  const double coarse = error_of(m, 500), fine = error_of(m, 2000);
  EXPECT_LE(coarse, 5e-5);
  EXPECT_LE(fine, 4e-6);
  EXPECT_LE(fine, coarse / 8);
  EXPECT_LE(error_of(m, 4000), 1e-6);
}

TEST(Circles, WhatAContactDoes) {
  const Mechanism m = pressed(0);
  const Result r = stepped(m, 4000);
  const ContactReport report = contact_report(m, r);
  ASSERT_FALSE(report.phases.empty());
  EXPECT_EQ(report.phases.back().state, ContactState::stick);
  EXPECT_NEAR(report.phases.back().begin, 3.4306343, 2e-3);
  EXPECT_LE(report.energy.error, 1e-5);
  EXPECT_GT(report.energy.friction, 0);
  const RowMatrix friction = m.friction_forces(r.t, r.x, r.y);
  for (Index j = 1; j <= r.steps; ++j) {
    const double bound = 0.2 * (9.81 + 4 * std::cos(7 * r.t[j]));
    EXPECT_LE(friction.row(j).norm(), bound * (1 + 1e-5));
    EXPECT_NEAR(r.y(j, 0), bound, 1e-12);
    const Eigen::Vector2d v = r.x.row(j).tail(2);
    if (v.norm() > 1e-3) EXPECT_LE((friction.row(j).transpose() + bound * v.normalized()).norm(), 1e-9 * bound) << j;
  }
  EXPECT_LE(r.residual, 1e-5);  // as far as rows of the step that stops are beyond the bound
}

TEST(Circles, HowTangentsLieDoesNotCount) {
  EXPECT_LE((positions(pressed(0), 300) - positions(pressed(0, 0.7), 300)).cwiseAbs().maxCoeff(), 1e-11);
}

// Polygons come near the circle with their corners.
TEST(Circles, FacetsComeNearTheCircle) {
  const double coarse = error_of(pressed(4), 1000), fine = error_of(pressed(32), 1000);
  EXPECT_GE(coarse, 1e-2);
  EXPECT_LE(fine, coarse / 4);
  EXPECT_LE(error_of(pressed(0), 1000), fine / 100);
}

// Motion along one tangent is that of a planar contact, across impacts and lift-off.
TEST(Circles, PlanarMotion) {
  for (const double e : {0.0, 0.5}) {
    const Structure planar = block(1.3, 10);
    Structure s = planar;
    Matrix M = Matrix::Identity(3, 3), K = Matrix::Identity(3, 3), C = Matrix::Identity(3, 3);
    K.topLeftCorner(2, 2) = Matrix(planar.K), C.topLeftCorner(2, 2) = Matrix(planar.C);
    s.M = sparse(M), s.K = sparse(K), s.C = sparse(C);
    s.f = forces([f = planar.f](double t) {
      Vector two(2), three = Vector::Zero(3);
      f(t, two);
      three.head(2) = two;
      return three;
    });
    Contact c = belt(e);
    c.normal = Vector{{0, 1, 0}};
    c.tangent = Matrix{{1, 0, 0}, {0, 0, 1}};
    c.velocity = forces([](double) { return Vector{{0.4, 0}}; });
    const Vector q = e == 0 ? Vector{{-0.2276458679, 0.0644897728}} : Vector{{-0.2024374329, 0.0637274032}};
    const Mechanism m = make_mechanism(s, {c});
    for (const auto& [steps, most] : {std::pair(250, 3e-4), {1000, 2e-5}, {4000, 1.2e-6}}) {
      const Vector found = positions(m, steps);
      EXPECT_LE((found.head(2) - q).cwiseAbs().maxCoeff(), most) << e << ", " << steps;
      EXPECT_LE(std::abs(found[2]), 1e-12);
    }
  }
}

Mechanism thrown(double mu, double e) {
  Structure s;
  s.M = sparse(2 * Matrix::Identity(3, 3));
  s.f = forces([](double) { return Vector{{0, 0, -2 * 9.81}}; });
  s.q0 = Vector{{0, 0, 0.5}}, s.v0 = Vector{{3, 4, 0}};
  s.T = 0.5;
  s.breakpoints_are_all = true;
  Contact c;
  c.normal = Vector{{0, 0, 1}};
  c.tangent = Matrix{{1, 0, 0}, {0, 1, 0}};
  c.mu = mu, c.restitution = e;
  return make_mechanism(s, {c});
}

// Newton's law and Coulomb's by hand: pt = -min(mu pn, m |vt|) along vt. 0.5 is before the second impact.
TEST(Circles, ABallOnTheGround) {
  const double v = std::sqrt(2 * 9.81 * 0.5), hit = v / 9.81, e = 0.8;
  for (const double mu : {0.3, 2.0}) {
    const Mechanism m = thrown(mu, e);
    const Result r = stepped(m, 100);
    const double left = std::max(0.0, 5 - mu * (1 + e) * v), after = 0.5 - hit;
    const Vector x = last_state(r);
    EXPECT_NEAR(x[3], 0.6 * left, 1e-11);
    EXPECT_NEAR(x[4], 0.8 * left, 1e-11);
    EXPECT_NEAR(x[0], 3 * hit + 0.6 * left * after, 1e-11);
    EXPECT_NEAR(x[2], e * v * after - 9.81 * after * after / 2, 1e-11);
    ASSERT_TRUE(r.impacts);
    ASSERT_EQ(r.impacts->size(), 1u);
    EXPECT_NEAR(r.impacts->front().t, hit, 1e-12);
    EXPECT_NEAR(r.impacts->front().p[0], 2 * (1 + e) * v, 1e-11);
  }
}

// It slides along a line, whose direction does not change, and stops after v^2 / (2 mu g).
TEST(Circles, ABallThatStops) {
  Mechanism m = thrown(0.6, 0);
  m.structure.q0 = Vector::Zero(3);
  m.structure.T = 2;
  const Mechanism flat = make_mechanism(m.structure, m.contacts);
  const double length = 25 / (2 * 0.6 * 9.81);
  const Vector q = positions(flat, 70);
  EXPECT_NEAR(q[0], 0.6 * length, 1e-11);
  EXPECT_NEAR(q[1], 0.8 * length, 1e-11);
  EXPECT_NEAR(q[2], 0, 1e-12);
}

TEST(Circles, OtherMethodsRefuse) {
  const Mechanism m = pressed(0);
  for (const Method method : {Method::events, Method::galerkin, Method::contour, Method::euler, Method::shooting}) {
    const Result r = run(m.scene, method, 100);
    EXPECT_EQ(r.status, Status::unsupported) << to_string(method);
    EXPECT_NE(r.reason.find("circles"), std::string::npos) << r.reason;
  }
  const Result r = run(m.scene, Method::automatic, 100);
  EXPECT_EQ(r.method, Method::march);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_TRUE(r.well_posed);
}

// By a tolerance alone.
TEST(Circles, ToATolerance) {
  Options options = options_for(Method::automatic);
  options.states = StateSelection::all;
  options.tolerance = 1e-4;
  const Result r = run(pressed(0).scene, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_LE((last_state(r).head(2) - exact).cwiseAbs().maxCoeff(), 1e-4);
}

}  // namespace
}  // namespace bromwich

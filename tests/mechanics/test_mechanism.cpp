// Structures with contacts against numbers of an event-located exact flow that shares no code with the library (its
// energy balance is met to 1e-11, and time stepping confirms it), and against closed forms.

#include "tests/mechanics/mechanisms.hpp"

#include "core/solve/dense_output.hpp"

#include <gtest/gtest.h>

#include <numbers>

namespace bromwich {
namespace {

constexpr double digits = 2e-9;  ///< the references have ten digits, of numbers of size 1

Contact friction_of(Matrix tangent, double bound, double velocity = 0) {
  Contact c;
  c.tangent = std::move(tangent);
  c.bound = always(bound);
  c.velocity = always(velocity);
  return c;
}

void expect_state(const Result& r, Index row, const Vector& x, double error = digits) {
  ASSERT_EQ(r.x.cols(), x.size());
  EXPECT_LE((r.x.row(row).transpose() - x).cwiseAbs().maxCoeff(), error) << r.x.row(row);
}

TEST(Mechanism, AGivenBoundOfFriction) {
  const Structure s = oscillator(
      0.05, 1, [](double t) { return 0.6 * std::cos(1.7 * t); }, 30);
  const Mechanism m = make_mechanism(s, {friction_of(Matrix{{1}}, 0.7, 0.3)});
  const Result r = located(m.scene);
  expect_state(r, r.steps, Vector{{0.3934447744, 0.3}});  // it sticks
  const RowMatrix lt = m.friction_forces(r.t, r.x, r.y);
  EXPECT_LE(lt.cwiseAbs().maxCoeff(), 0.7 + 1e-12);
}

TEST(Mechanism, APeriodicStateWithTwoBounds) {
  Structure s;
  const Matrix K{{2, -1}, {-1, 2}};
  s.M = sparse(Matrix::Identity(2, 2)), s.K = sparse(K), s.C = sparse(Matrix(0.02 * K));
  s.f = forces([](double t) { return Vector{{1.2 * std::cos(1.3 * t), 0}}; });
  s.T = 2 * std::numbers::pi / 1.3;
  s.periodic = true;
  s.breakpoints_are_all = true;
  const Mechanism m = make_mechanism(s, {friction_of(Matrix{{1, 0}}, 0.3), friction_of(Matrix{{0, 1}}, 0.5)});
  const Vector x0{{-0.0489075006, -0.7808519813, 0.9068141232, 0.2542543642}};
  expect_state(located(m.scene), 0, x0, 1e-8);  // Newton's iteration ends at that
}

TEST(Mechanism, ABlockOnABelt) {
  const Mechanism m = make_mechanism(block(0.6, 20), {belt()});
  const Result r = located(m.scene);
  expect_state(r, r.steps, Vector{{0.3061912019, 0, 0.3000815285, 0}});
  const RowMatrix total = integral_of_y(r);
  const double normal = total(r.steps, m.rows[0].normal), b = total(r.steps, m.rows[0].friction);
  EXPECT_NEAR(normal, 18.3080252654, 20 * digits);
  EXPECT_NEAR(b - 0.4 * normal, 6.6251247212, 20 * digits);
}

TEST(Mechanism, ABlockThatLiftsOffAndStrikes) {
  const Result plastic = located(make_mechanism(block(1.3, 10), {belt()}).scene);
  expect_state(plastic, plastic.steps, Vector{{-0.2276458679, 0.0644897728, -0.2264338204, -0.5182400725}});
  const Result bouncing = located(make_mechanism(block(1.3, 10), {belt(0.5)}).scene);
  expect_state(bouncing, bouncing.steps, Vector{{-0.2024374329, 0.0637274032, -0.2157451367, -0.5111438908}}, 1e-8);
}

TEST(Mechanism, ABallThatBounces) {
  Structure s = oscillator(
      0, 0, [](double) { return -9.81; }, 1.5);
  s.q0 = Vector{{1}};
  Contact ground;
  ground.normal = Vector{{1}};
  ground.restitution = 0.5;
  const Result r = located(make_mechanism(s, {ground}).scene);
  expect_state(r, r.steps, Vector::Zero(2));
  // It rests from 3 sqrt(2/9.81) = 1.3546 on, and bounces before.
  const double rest = 3 * std::sqrt(2 / 9.81);
  for (Index j = 0; j <= r.steps; ++j) {
    if (r.t[j] > rest + 1e-6) EXPECT_NEAR(r.y(j, 0), 9.81, 1e-8) << r.t[j];
    if (r.t[j] < 0.9 * rest) EXPECT_EQ(r.y(j, 0), 0) << r.t[j];
  }
}

struct Rod {
  Structure structure;
  Contact contact;
};

Rod rod(double mu, double lift) {
  const double a = 1 / std::sqrt(2);
  Rod rod;
  rod.structure.M = sparse(Matrix(Vector{{1, 1, 1.0 / 3}}.asDiagonal()));
  rod.structure.f = forces([lift](double) { return Vector{{0, lift, 0}}; });
  rod.structure.v0 = Vector{{-2, 0, 0}};
  rod.structure.T = 0.2;
  rod.structure.breakpoints_are_all = true;
  rod.contact.normal = Vector{{0, 1, -a}};
  rod.contact.tangent = Matrix{{1, 0, a}};
  rod.contact.mu = mu;
  return rod;
}

TEST(Mechanism, ARodThatSlidesAndSticks) {
  const Rod given = rod(1.6, -9.81);
  const Result r = located(make_mechanism(given.structure, {given.contact}).scene);
  EXPECT_LE((last_state(r).head(3) - Vector{{-0.08152184, 0.073366896, 0.1037564594}}).cwiseAbs().maxCoeff(), 1e-8);
}

// Painlevé: no force keeps it sliding, and an impulse at t = 0 stops it. It sticks behind.
TEST(Mechanism, ARodThatJams) {
  const Rod given = rod(2, -9.81);
  const Result r = located(make_mechanism(given.structure, {given.contact}).scene);
  EXPECT_TRUE(r.starts_with_impulse || r.x.row(1)[3] > -1) << "it slides on";
  const double a = 1 / std::sqrt(2), t = 0.2;
  // From v = (-3/4, 3/4, 3/(4 a)) with the contact closed and sticking: (q_0, q_1) = (-s, s), q_2 = s / a, and
  // (1 + 1 + 1/3 / a^2) s'' = -9.81.
  const double s = 0.75 * t - 9.81 / (2 + 1 / (3 * a * a)) * t * t / 2;
  EXPECT_LE((last_state(r).head(3) - Vector{{-s, s, s / a}}).cwiseAbs().maxCoeff(), digits);
}

TEST(Mechanism, ARodWithSeveralSolutionsIsNotSolved) {
  const Rod given = rod(2, 3);
  const Result r = run(make_mechanism(given.structure, {given.contact}).scene, options_for(Method::events));
  EXPECT_EQ(r.status, Status::tolerance_not_met);
  EXPECT_NE(r.reason.find("not unique"), std::string::npos) << r.reason;
}

// A mass on a plane: the circle of friction forces as a polygon with d corners. Its sides are nearer to the centre by
// the factor cos(pi/d), which is 1 - 0.5 % with 32 facets and 1 - 0.12 % with 64, and the path is 2 long. The reference
// is that of the circle.
TEST(Mechanism, FacetsApproachTheCircle) {
  Structure s;
  s.M = sparse(Matrix::Identity(2, 2)), s.K = sparse(Matrix(Vector{{4, 9}}.asDiagonal()));
  s.f = forces([](double t) { return Vector{{1.5 * std::sin(3 * t) + 0.5, 1.2 * std::cos(2 * t)}}; });
  s.q0 = Vector{{0.5, 0.8}}, s.v0 = Vector{{2, 0}};
  s.T = 4;
  s.breakpoints_are_all = true;
  const Vector circle{{0.0290263945, 0.097645178}};
  for (const auto& [d, error] : {std::pair<Index, double>(32, 1e-2), {64, 2.5e-3}}) {
    Contact plane;
    plane.tangent = Matrix::Identity(2, 2);
    plane.bound = of_time([](double t) { return 0.2 * (9.81 + 4 * std::cos(7 * t)); });
    plane.facets = d;
    Options options = marched(4000);
    const Result r = run(make_mechanism(s, {plane}).scene, options);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_LE((last_state(r).head(2) - circle).cwiseAbs().maxCoeff(), error) << d;
    EXPECT_LE(last_state(r).tail(2).norm(), 1e-10) << "it sticks from 3.43 on";
  }
}

TEST(Mechanism, AnObliqueImpact) {
  const Result r = located(oblique_impact().scene);
  expect_state(r, r.steps, Vector{{-0.3086956522, 0, -0.1739130435, 0}});
}

// A mass is pulled with 0.8 against an element with kt = 2 and R = 0.5, which slips from q = 0.25 on.
TEST(Mechanism, AJenkinsElement) {
  Structure s = oscillator(
      0, 0, [](double) { return 0.8; }, 3);
  Contact element = friction_of(Matrix{{1}}, 0.5);
  element.kt = 2;
  const Mechanism m = make_mechanism(s, {element});
  EXPECT_EQ(m.rows[0].state, 2);
  const Result r = located(m.scene);
  // q'' = 0.8 - 2 q from rest, q = 0.4 (1 - cos(sqrt(2) t)), until 2 q = 0.5; then q'' = 0.3.
  const double w = std::sqrt(2.0), slip = std::acos(1 - 0.25 / 0.4) / w, v = 0.4 * w * std::sin(w * slip);
  const double left = 3 - slip;
  expect_state(r, r.steps, Vector{{0.25 + v * left + 0.15 * left * left, v + 0.3 * left, 0.5}});
}

// A compliant contact with a Jenkins element: the block of a rigid one, in the limit of stiff springs. Forces are up to
// 2, springs overshoot by twice that over k, and in 4 units of time a block moves by less than 5 times its disturbance.
TEST(Mechanism, StiffContactsApproachRigidOnes) {
  const Vector rigid = last_state(located(make_mechanism(block(0.6, 4), {belt()}).scene));
  for (const double k : {1e3, 1e4}) {
    Contact stiff = belt();
    stiff.kn = k;
    const double of_normal = (last_state(located(make_mechanism(block(0.6, 4), {stiff}).scene)) - rigid).head(2).norm();
    stiff.kt = k;
    const Result r = located(make_mechanism(block(0.6, 4), {stiff}).scene);
    const double both = (last_state(r).head(4) - rigid).head(2).norm();
    EXPECT_LE(std::max(of_normal, both), 20 / k);
  }
}

TEST(Mechanism, RelaysActBesideContacts) {
  // A block on rough ground, driven by -Sgn(v - 1): it slips with mu g = 0.5 against a force of 1 until v = 1.
  Structure s;
  s.M = sparse(Matrix::Identity(2, 2));
  s.f = forces([](double) { return Vector{{0, -1}}; });
  s.T = 4;
  s.breakpoints_are_all = true;
  Contact ground = belt();
  ground.velocity = {};
  ground.mu = 0.5;
  Relays motor;
  motor.B = Matrix{{1}, {0}};
  motor.C = Matrix{{0, 0, 1, 0}};
  motor.e = always(-1);
  const Mechanism m = make_mechanism(s, {ground}, motor);
  EXPECT_EQ(m.rows[0].normal, 2);
  const Result r = located(m.scene);
  expect_state(r, r.steps, Vector{{0.25 * 4 + 2, 0, 1, 0}}, 1e-8);  // 1/2 · 1/2 · 2² while it accelerates, then v = 1
}

TEST(Mechanism, MirroredStructuresHaveMirroredMotions) {
  Structure mirrored = block(1.3, 6);
  const Matrix D = Vector{{-1, 1}}.asDiagonal();
  for (SparseMatrix* m : {&mirrored.M, &mirrored.C, &mirrored.K}) *m = sparse(D * Matrix(*m) * D);
  mirrored.f = forces([f = block(1.3, 6).f](double t) {
    Vector value(2);
    f(t, value);
    value[0] = -value[0];
    return value;
  });
  for (const double e : {0.0, 0.5}) {
    Contact other = belt(e);
    other.tangent = -other.tangent * D;
    other.velocity = always(-0.4);
    const Vector x = last_state(located(make_mechanism(block(1.3, 6), {belt(e)}).scene));
    const Vector y = last_state(located(make_mechanism(mirrored, {other}).scene));
    EXPECT_LE((y - Vector{{-x[0], x[1], -x[2], x[3]}}).cwiseAbs().maxCoeff(), digits) << y.transpose();
  }
}

// Lengths in millimetres: q, f and g are 1000 times as large, mu and e have no unit.
TEST(Mechanism, OtherUnitsHaveTheSameMotion) {
  Structure other = block(1.3, 6);
  other.f = forces([f = other.f](double t) {
    Vector value(2);
    f(t, value);
    return Vector(1000 * value);
  });
  Contact of_other = belt(0.5);
  of_other.velocity = always(400);
  const Vector x = last_state(located(make_mechanism(block(1.3, 6), {belt(0.5)}).scene));
  const Vector y = last_state(located(make_mechanism(other, {of_other}).scene));
  EXPECT_LE((y / 1000 - x).cwiseAbs().maxCoeff(), digits);
}

TEST(Mechanism, SourcesAreLinesWhereTheirPartsAre) {
  const TimeFunction speed = LinearSource{[](double t, Eigen::Ref<Vector> v) { v[0] = 0.1 + t; }};
  const Structure s = block(1, 1);
  Contact c = belt();
  c.velocity = speed;
  EXPECT_TRUE(make_mechanism(s, {c}).scene.g.linear());
  c.gap = of_time([](double t) { return t * t; });
  const Scene bent = make_mechanism(s, {c}).scene;
  EXPECT_FALSE(bent.g.linear());
  Vector g(3);
  bent.g(0.5, g);
  EXPECT_EQ(g, (Vector{{0.25, -0.6, 0}}));
  Contact jaw;
  jaw.tangent = Matrix{{0, 1}}, jaw.bound = speed, jaw.velocity = speed, jaw.kt = 2;
  const Scene spring = make_mechanism(s, {jaw}).scene;
  Vector f(5), room(2);
  spring.f(0.5, f), spring.g(0.5, room);
  EXPECT_FALSE(spring.f.linear());  // that of the structure is not
  EXPECT_NEAR(f[4], -1.2, 1e-15);   // -kt V
  EXPECT_EQ(room, Vector::Constant(2, 0.6));
}

// A chain with many states is sparse with a mass matrix, and is the same system.
TEST(Mechanism, ManyCoordinatesAreSparse) {
  constexpr Index d = 150;
  Structure s;
  Matrix K = 2 * Matrix::Identity(d, d);
  K.diagonal(1).setConstant(-1);
  K.diagonal(-1).setConstant(-1);
  s.M = sparse(Matrix(2 * Matrix::Identity(d, d))), s.K = sparse(K), s.C = sparse(Matrix(0.1 * K));
  s.f = forces([](double t) { return Vector::Constant(d, std::sin(t)); });
  Contact stop;
  stop.normal = -Vector::Unit(d, d / 2);
  stop.gap = always(0.05);
  const Scene sparse_scene = make_mechanism(s, {stop}).scene;
  const auto* found = get_if<SparseDynamics>(&sparse_scene.dynamics);
  ASSERT_NE(found, nullptr);
  EXPECT_EQ(found->E.coeff(d, d), 2);
  const Result r = run(sparse_scene, marched(400));
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_LE(r.x.col(d / 2).maxCoeff(), 0.05 + 1e-10);
  EXPECT_GT(r.y.maxCoeff(), 0);
}

}  // namespace
}  // namespace bromwich

// March over impacts: structures with rigid contacts, friction and restitution, against reference digits, closed forms
// and located events.

#include "tests/mechanics/mechanisms.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

namespace bromwich {
namespace {

DrawnStructure drawn_structure(std::uint32_t seed) {
  return random_structure(seed, 1 + Index(seed % 4), 2, false, {0, 0.1, 0.3, 0.6, 1});
}

// Without the certificate, which is a solve by method events.
Result stepped(const Scene& scene, Index steps) {
  Options options = marched(steps);
  options.confirm = false;
  return run(scene, options);
}

Vector positions(const Result& r) {
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  return r.x.row(r.steps).head(r.x.cols() / 2).transpose();
}

double error_of(const Scene& scene, Index steps, const Vector& q) {
  return (positions(stepped(scene, steps)).head(q.size()) - q).cwiseAbs().maxCoeff();
}

TEST(ImpactSteps, ABlockThatLiftsOffAndStrikes) {
  for (const double e : {0.0, 0.5}) {
    const Vector q = e == 0 ? Vector{{-0.2276458679, 0.0644897728}} : Vector{{-0.2024374329, 0.0637274032}};
    const Scene scene = make_mechanism(block(1.3, 10), {belt(e)}).scene;
    EXPECT_LE(error_of(scene, 250, q), 3e-4);
    EXPECT_LE(error_of(scene, 1000, q), 2e-5);
    EXPECT_LE(error_of(scene, 4000, q), 1.2e-6);
  }
}

// Whether h^2 times the largest ratio seen on coarse grids bounds the errors on fine ones. They do not fall from grid
// to grid: where in its step a contact opens is up to chance.
bool is_of_order_two(const Scene& scene, const Vector& q) {
  constexpr double chance = 8, exact_digits = 1e-9;
  double ratio = 0;
  for (const Index steps : {100, 150, 200, 300})
    ratio = std::max(ratio, error_of(scene, steps, q) * double(steps * steps));
  for (const Index steps : {1500, 3000})
    if (!(error_of(scene, steps, q) <= chance * ratio / double(steps * steps) + exact_digits)) return false;
  return true;
}

void expect_order_two(const Scene& scene) { EXPECT_TRUE(is_of_order_two(scene, positions(located(scene)))); }

// Against located events, which refuse one of these scenes. In some, flights shorter than an eighth of a step appear on
// finer grids alone, where coarse ones have errors far below the square of the step.
TEST(ImpactSteps, RandomStructuresAreOfOrderTwo) {
  std::string others;
  int tested = 0, of_order_two = 0;
  for (std::uint32_t seed = 0; seed < 100; ++seed) {
    const DrawnStructure drawn = drawn_structure(seed);
    const Scene scene = make_mechanism(drawn.structure, drawn.contacts).scene;
    Options options = options_for(Method::events);
    options.states = StateSelection::all;
    const Result exact = run(scene, options);
    if (exact.status != Status::solved) continue;
    ++tested;
    if (is_of_order_two(scene, positions(exact)))
      ++of_order_two;
    else
      others += " " + std::to_string(seed);
  }
  EXPECT_GE(tested, 98);
  EXPECT_GE(of_order_two, tested - 1) << "not seeds" << others;
}

TEST(ImpactSteps, MirrorImages) {
  for (std::uint32_t seed = 0; seed < 60; ++seed) {
    const DrawnStructure drawn = drawn_structure(seed);
    const Vector signs = drawn_signs(seed, drawn.structure.M.rows());
    const DrawnStructure image = mirrored(drawn, signs);
    const Result r = stepped(make_mechanism(drawn.structure, drawn.contacts).scene, 400),
                 s = stepped(make_mechanism(image.structure, image.contacts).scene, 400);
    EXPECT_LE((positions(r) - signs.cwiseProduct(positions(s))).cwiseAbs().maxCoeff(), 1e-10) << seed;
  }
}

Scene ball(double e, double T) {
  Structure s = oscillator(
      0, 0, [](double) { return -9.81; }, T);
  s.q0 = Vector{{1}};
  Contact ground;
  ground.normal = Vector{{1}};
  ground.restitution = e;
  return make_mechanism(s, {ground}).scene;
}

TEST(ImpactSteps, ABallThatComesToRest) {
  const double rest = 3 * std::sqrt(2 / 9.81);
  const Result r = stepped(ball(0.5, 1.5), 150);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  for (Index j = 0; j <= r.steps; ++j) {
    if (r.t[j] > rest) EXPECT_LE(std::abs(r.x(j, 0)), 1e-12) << r.t[j];
    if (r.t[j] > rest + 0.01) EXPECT_NEAR(r.y(j, 0), 9.81, 1e-9) << r.t[j];
    if (r.t[j] < 0.9 * rest) EXPECT_EQ(r.y(j, 0), 0) << r.t[j];
  }
  EXPECT_NEAR(r.y_integral(150, 0), 9.81 * 1.5, 1e-9);
}

TEST(ImpactSteps, NothingIsLostWithoutLoss) {
  const Result r = stepped(ball(1, 10), 333);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  for (Index j = 0; j <= r.steps; ++j) EXPECT_NEAR(r.x(j, 0) + r.x(j, 1) * r.x(j, 1) / (2 * 9.81), 1, 1e-11) << r.t[j];
}

TEST(ImpactSteps, AnImpactAtTheBegin) {
  Structure s = block(1.3, 2);
  s.v0 = Vector{{0.2, -1}};
  const Scene scene = make_mechanism(s, {belt(0.5)}).scene;
  const Result r = stepped(scene, 100);
  EXPECT_TRUE(r.starts_with_impulse);
  expect_order_two(scene);
}

// A floor that goes up and down along straight lines strikes what lies on it.
TEST(ImpactSteps, AFloorThatTurns) {
  for (const double e : {0.0, 0.5}) {
    Structure s = oscillator(
        0.1, 1, [](double) { return -3.0; }, 4);
    s.breakpoints = {0.9, 1.7, 2.6};
    Contact floor;
    floor.normal = Vector{{1}};
    floor.restitution = e;
    floor.gap = of_time([](double t) {
      if (t < 0.9) return 0.2 * t;
      if (t < 1.7) return 0.18 - 0.5 * (t - 0.9);
      return t < 2.6 ? -0.22 : -0.22 + 0.3 * (t - 2.6);
    });
    expect_order_two(make_mechanism(s, {floor}).scene);
  }
}

TEST(ImpactSteps, RelaysAndMovingBodies) {
  Structure s = block(1.3, 6);
  Relays motor;
  motor.B = Matrix{{0.3}, {0}};
  motor.C = Matrix{{0, 0, 1, 0}};
  motor.e = always(-0.2);
  Contact moving = belt(0.4);
  moving.velocity = of_time([](double t) { return 0.4 + 0.2 * std::sin(t); });
  moving.gap = of_time([](double t) { return 0.05 * std::sin(3 * t); });
  expect_order_two(make_mechanism(s, {moving}, motor).scene);
}

// Blocks with springs between them, each on a belt of its own.
Mechanism chain(Index blocks, double restitution) {
  const Index d = 2 * blocks;
  Matrix K = Matrix::Zero(d, d);
  std::vector<Contact> contacts;
  for (Index i = 0; i < blocks; ++i) {
    const Index x = 2 * i, z = x + 1;
    K(x, x) += 2, K(z, z) += 1.5, K(x, z) -= 0.6, K(z, x) -= 0.6;
    if (i + 1 < blocks) K(x, x) += 1, K(x + 2, x + 2) += 1, K(x, x + 2) -= 1, K(x + 2, x) -= 1;
    Contact c = belt(restitution);
    c.normal = Vector::Unit(d, z);
    c.tangent = Vector::Unit(d, x).transpose();
    contacts.push_back(c);
  }
  Structure s;
  s.M = sparse(Matrix::Identity(d, d)), s.K = sparse(K);
  s.C = sparse(Matrix(0.04 * Matrix::Identity(d, d) + 0.01 * K));
  s.f = forces([d](double t) {
    Vector f(d);
    for (Index i = 0; i < d / 2; ++i) {
      f[2 * i] = 0.3 * std::sin(2.1 * t + double(i));
      f[2 * i + 1] = -1 + 1.3 * std::cos(2.1 * t + 0.7 * double(i));
    }
    return f;
  });
  s.T = 4;
  s.breakpoints_are_all = true;
  return make_mechanism(s, contacts);
}

TEST(ImpactSteps, ManyContacts) {
  const Scene sixteen = chain(16, 0.5).scene;
  EXPECT_LE(error_of(sixteen, 200, positions(located(sixteen))), 1e-4);
  // Above what located events take, by march alone.
  const Scene more = chain(64, 0.5).scene;
  Options options = marched(200);
  options.method = Method::automatic;
  const Result r = run(more, options);
  EXPECT_EQ(r.method, Method::march);
  EXPECT_TRUE(r.well_posed);
  EXPECT_LE((positions(r) - positions(stepped(more, 1600))).cwiseAbs().maxCoeff(), 1e-4);
}

// A velocity that jumps by a whole size at a row beside an impact is no error of that size.
TEST(ImpactSteps, ToATolerance) {
  for (const double e : {0.0, 0.5}) {
    const Vector q = e == 0 ? Vector{{-0.2276458679, 0.0644897728}} : Vector{{-0.2024374329, 0.0637274032}};
    const Scene scene = make_mechanism(block(1.3, 10), {belt(e)}).scene;
    Index before = 0;
    for (const double tolerance : {1e-2, 1e-3, 1e-4}) {
      Options options = options_for(Method::march);
      options.states = StateSelection::all;
      options.tolerance = tolerance;
      const Result r = run(scene, options);
      ASSERT_EQ(r.status, Status::solved) << r.reason;
      EXPECT_LE((positions(r) - q).cwiseAbs().maxCoeff(), tolerance);
      EXPECT_LE(*r.error_estimate, tolerance);
      EXPECT_GE(r.steps, before);
      before = r.steps;
    }
  }
}

// Friction that slips has y that is no force, a speed. Its mean has the order of the others, and hundreds of steps do.
TEST(ImpactSteps, SlipTakesNoMoreSteps) {
  for (const std::uint32_t seed : {3u, 6u, 12u, 14u, 15u, 16u}) {
    const DrawnStructure drawn = drawn_structure(seed);
    const Scene scene = make_mechanism(drawn.structure, drawn.contacts).scene;
    Options options = options_for(Method::march);
    options.tolerance = 1e-3;
    const Result r = run(scene, options);
    EXPECT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_LE(r.steps, 3200) << seed;
  }
}

// Without located events to measure errors by: by the differences of grids alone.
TEST(ImpactSteps, ManyContactsToATolerance) {
  const Scene many = chain(32, 0.5).scene;
  Options options = options_for(Method::automatic);
  options.states = StateSelection::all;
  options.tolerance = 1e-3;
  const Result r = run(many, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.method, Method::march);
  EXPECT_LE((positions(r) - positions(stepped(many, 6400))).cwiseAbs().maxCoeff(), 1e-3);
}

// With many impacts located events need more operations than grids: method automatic tries both, with restitution too.
TEST(ImpactSteps, AutomaticTakesWhatNeedsLess) {
  const Scene sixteen = chain(16, 0.5).scene;
  Options options = options_for(Method::automatic);
  options.states = StateSelection::all;
  options.tolerance = 1e-4;
  const Result r = run(sixteen, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.method, Method::march);
  EXPECT_LE((positions(r) - positions(located(sixteen))).cwiseAbs().maxCoeff(), 1e-4);
  const Result one = run(make_mechanism(block(1.3, 2), {belt(0.5)}).scene, options);
  ASSERT_EQ(one.status, Status::solved) << one.reason;
  EXPECT_EQ(one.method, Method::events);
}

// The certificate compares rows with located events, on the side of impacts that they are on.
TEST(ImpactSteps, CertificatesKnowImpacts) {
  const Result r = run(make_mechanism(block(1.3, 10), {belt(0.5)}).scene, marched(1000));
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  ASSERT_TRUE(r.certificate);
  EXPECT_LE(r.certificate->error_of_x, 5e-3);
  EXPECT_EQ(r.warning.find("off by"), std::string::npos) << r.warning;
}

// A stiff contact on one side, a rigid one that throws back on the other.
TEST(ImpactSteps, CompliantContactsBesideRigidOnes) {
  Contact bounces = belt(0.5);
  bounces.normal = Vector{{0, -1}};
  bounces.gap = always(0.2);
  for (const double kn : {10.0, 100.0, 1e4}) {
    Contact compliant = belt();
    compliant.kn = kn;
    expect_order_two(make_mechanism(block(1.3, 4), {compliant, bounces}).scene);
  }
}

TEST(ImpactSteps, OtherRowsAreRefused) {
  Contact Jenkins = belt();
  Jenkins.kt = 100;
  Contact bounces = belt(0.5);
  bounces.normal = Vector{{0, -1}};
  bounces.gap = always(1);
  const Result r = stepped(make_mechanism(block(1.3, 2), {Jenkins, bounces}).scene, 100);
  EXPECT_EQ(r.status, Status::unsupported);
  EXPECT_NE(r.reason.find("restitution"), std::string::npos) << r.reason;
}

}  // namespace
}  // namespace bromwich

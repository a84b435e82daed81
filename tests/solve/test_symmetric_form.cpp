// Constant advection along and across the contact: the symmetric form against the same scene written out.

#include "core/solve/symmetric_form.hpp"

#include "core/dynamics/dynamics.hpp"
#include "core/dynamics/rectangle.hpp"
#include "core/solve/solver.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

namespace bromwich::symmetric_form_test {
namespace {

// |v| L/(2c): a factor of e^v over the line.
GridLine line(Index points, double v, EndCondition first, EndCondition last) {
  return {points, GridLine::spacing_of(points, 1, first, last), 0.05, 0.1 * v, first, last};
}

// 24 x 25 points: above 512 states.
Rectangle rectangle(double along, double across) {
  Rectangle r;
  r.along = line(24, along, EndCondition(3.), neumann);
  r.across = line(25, across, dirichlet, EndCondition(across < 0 ? 3 : 0.5));
  r.reaction = 0.3;
  r.b = r.n = Vector::Zero(25);
  r.b[0] = 1 / r.across.spacing, r.b[1] = 0.3, r.n[0] = 1;
  return r;
}

std::vector<Rectangle> rectangles() {
  std::vector<Rectangle> all{rectangle(0, 1.5), rectangle(0, -2), rectangle(2, 0), rectangle(1, 1.5)};
  Rectangle box = rectangle(1, 0.5);
  box.along.points = 6, box.beside = {line(5, -0.7, neumann, dirichlet)};
  all.push_back(box);
  Rectangle two = rectangle(2, 0);
  two.across = line(25, 0, EndCondition(0.5), EndCondition(0.5));
  two.far_b = two.b, two.far_n = two.n;
  all.push_back(two);
  return all;
}

Rectangle written_out(Rectangle r) {
  r.written_out = true;
  return r;
}

Scene contact_on(const Rectangle& r, double compliance) {
  Scene scene;
  scene.name = "rectangle";
  scene.dynamics = r;
  const Index n = r.lines() * r.sides(), points = r.across.points;
  scene.M = Tridiagonal{Vector::Zero(n), Vector::Constant(n, compliance), Vector::Zero(n)};
  scene.f = [n](double t, Eigen::Ref<Vector> phi) {
    for (Index i = 0; i < n; ++i) phi[i] = 0.1 * std::cos(3 * t + 0.3 * double(i));
  };
  scene.f_entry = SourceEntry::through_B;
  scene.g = [n](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < n; ++i) g[i] = 0.3 * std::sin(4 * t + 0.2 * double(i)) - 0.1;
  };
  scene.x0 = Vector::NullaryExpr(
      r.states(), [&](Index i) { return 0.2 * std::cos(double(i % points) / 9) + 0.01 * double(i % 7); });
  scene.T = 1;
  return scene;
}

Options with_states(Method method, Index steps) {
  Options options = options_for(method, steps);
  options.states = StateSelection::list;
  options.components = {0, 5, 24, 25 * 11 + 3, 599};
  options.trace = true;
  return options;
}

bool in_form(const Result& r) { return r.kernel.find("symmetric form") != std::string::npos; }

TEST(SymmetricForm, IsSimilarToTheMatrices) {
  for (const Rectangle& r : rectangles()) {
    const auto form = r.symmetric_form();
    ASSERT_TRUE(form);
    const SparseDynamics modes = to_sparse(form->modes), given = get<SparseDynamics>(Dynamics(written_out(r)));
    const Vector x = form->x.cwiseInverse(), y = form->y.cwiseInverse();
    const Matrix A = x.asDiagonal() * Matrix(given.A) * form->x.asDiagonal();
    // The logarithms of the factors have a rounding of 25 eps.
    EXPECT_LE((A - Matrix(modes.A)).cwiseAbs().maxCoeff(), 100 * epsilon * A.cwiseAbs().maxCoeff());
    const Matrix B = x.asDiagonal() * Matrix(given.B) * form->y.asDiagonal();
    EXPECT_LE((B - Matrix(modes.B)).cwiseAbs().maxCoeff(), 100 * epsilon * B.cwiseAbs().maxCoeff());
    const Matrix N = y.asDiagonal() * Matrix(given.N) * form->x.asDiagonal();
    EXPECT_LE((N - Matrix(modes.N)).cwiseAbs().maxCoeff(), 100 * epsilon * N.cwiseAbs().maxCoeff());
  }
}

TEST(SymmetricForm, IsRefusedWhereItWouldCostDigits) {
  EXPECT_FALSE(rectangle(0, 0).symmetric_form()) << "nothing to remove";
  EXPECT_TRUE(rectangle(0, 6).symmetric_form());
  EXPECT_FALSE(rectangle(0, 8).symmetric_form()) << "factors of e^8";
  Rectangle r = rectangle(1, 1);
  r.along.first = neumann;
  EXPECT_FALSE(r.symmetric_form()) << "flows in where it is insulated";
  r = rectangle(1, 1);
  r.far_b = r.b, r.far_n = r.n;
  EXPECT_FALSE(r.symmetric_form()) << "two sides with a flow from one to the other";
  r = rectangle(1, 1);
  r.along.points = 20;
  EXPECT_FALSE(r.symmetric_form()) << "500 states are dense";
}

// Weights of both to 1e-12, which factors of e^3 and the constraint amplify below 1e4.
TEST(SymmetricForm, SolvesWhatTheMatricesDo) {
  for (const Rectangle& r : rectangles())
    for (const double compliance : {0.0, 0.7}) {
      const Result form = run(contact_on(r, compliance), with_states(Method::march, 64)),
                   sparse = run(contact_on(written_out(r), compliance), with_states(Method::march, 64));
      ASSERT_EQ(form.status, Status::solved) << form.reason;
      ASSERT_EQ(sparse.status, Status::solved) << sparse.reason;
      EXPECT_TRUE(in_form(form));
      EXPECT_FALSE(in_form(sparse));
      EXPECT_LE(form.residual, 1e-10);
      EXPECT_GT((form.y.array() > 0).count(), 100);
      EXPECT_LE(distance(form.y.bottomRows(64), sparse.y.bottomRows(64)), 1e-8 * sparse.y.maxCoeff()) << form.kernel;
      EXPECT_LE(distance(form.x, sparse.x), 1e-8) << form.kernel;
      EXPECT_LE(distance(form.trace, sparse.trace), 1e-8) << form.kernel;
    }
}

TEST(SymmetricForm, AllMethodsTakeIt) {
  const Rectangle r = rectangle(1.5, 1);
  Scene scene = contact_on(r, 3);
  Tridiagonal M{Vector::Constant(24, -0.6), Vector::Constant(24, 3), Vector::Constant(24, -0.4)};
  for (const bool diagonal : {true, false}) {
    if (!diagonal) scene.M = M;
    const RowMatrix known = solved_y(scene, Method::march, 128);
    for (const Method method : {Method::automatic, Method::contour, Method::multigrid}) {
      const Result found = run(scene, method, 128);
      ASSERT_EQ(found.status, Status::solved) << to_string(method) << ": " << found.reason;
      EXPECT_TRUE(in_form(found));
      EXPECT_LE(distance(found.y.bottomRows(128), known.bottomRows(128)), 1e-7 * known.maxCoeff()) << to_string(method);
    }
  }
  const Scene rigid = contact_on(r, 0), sparse = contact_on(written_out(r), 0);
  EXPECT_LE(
      distance(solved_y(rigid, Method::euler, 64).bottomRows(64), solved_y(sparse, Method::euler, 64).bottomRows(64)),
      1e-8 * solved_y(sparse, Method::euler, 64).maxCoeff());
  EXPECT_TRUE(in_form(run(rigid, Method::dual, 128)));
}

TEST(SymmetricForm, LeavesWhatItDoesNotTake) {
  const Rectangle r = rectangle(1, 1);
  Scene scene = contact_on(r, 0.7);
  Options options = options_for(Method::march, 32);
  EXPECT_TRUE(in_form(run(scene, options)));
  scene.M = Tridiagonal{Vector::Constant(24, -1), Vector::Constant(24, 2), Vector::Constant(24, -1)};
  scene.lcp_class = LcpClass::PSD;
  EXPECT_FALSE(in_form(run(scene, options))) << "factors may change the class";
  scene = contact_on(r, 0.7);
  scene.f_entry = SourceEntry::state;
  scene.f = [](double t, Eigen::Ref<Vector> f) { f.setConstant(0.1 * std::sin(t)); };
  EXPECT_FALSE(in_form(run(scene, options))) << "f of states";
}

TEST(SymmetricForm, IsKeptByASolver) {
  const auto backend = make_cpu_backend(1);
  Scene scene = contact_on(rectangle(1, 1), 0.7);
  Solver solver(scene, *backend, with_states(Method::march, 32));
  solver.solve();
  scene.x0 *= -0.5;
  solver.set_x0(scene.x0);
  const Result again = solver.solve(), fresh = run(scene, with_states(Method::march, 32));
  EXPECT_TRUE(in_form(again));
  EXPECT_LE(distance(again.y, fresh.y), 1e-12 * fresh.y.maxCoeff());
  EXPECT_LE(distance(again.x, fresh.x), 1e-12);
}

}  // namespace
}  // namespace bromwich::symmetric_form_test

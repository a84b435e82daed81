// Kronecker sums with constraints on two opposite faces, in modes, against the same written out as matrices.

#include "core/dynamics/dynamics.hpp"
#include "core/dynamics/rectangle.hpp"
#include "core/dynamics/sparse.hpp"
#include "derivatives/space_time_derivative.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include <cmath>
#include <string>

namespace bromwich {
namespace {

GridLine points_with_ends(Index points, EndCondition first, EndCondition last) {
  return {points, GridLine::spacing_of(points, 1, first, last), 0.05, 0, first, last};
}

Rectangle two_sided(Index lines, Index points, EndCondition ends) {
  Rectangle r;
  r.along = points_with_ends(lines, neumann, 1.5), r.across = points_with_ends(points, ends, ends), r.reaction = 0.3;
  r.b = r.n = Vector::Zero(points);
  r.b[0] = 1 / r.across.spacing, r.n[0] = 1.5, r.n[1] = -0.5;
  r.far_b = r.b, r.far_n = r.n;
  return r;
}

Rectangle in_matrices(Rectangle r) {
  r.written_out = true;
  return r;
}

// Neither x0 nor g nor f is the same on both sides.
Scene held_on_both(const Rectangle& r, double compliance) {
  Scene scene;
  scene.name = "two sides";
  scene.dynamics = r;
  const Index n = 2 * r.lines(), points = r.across.points;
  scene.M = Tridiagonal{Vector::Zero(n), Vector::Constant(n, compliance), Vector::Zero(n)};
  scene.g = [n](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < n; ++i) g[i] = 0.3 * std::sin(4 * t + 0.2 * double(i)) - 0.1;
  };
  scene.f = [](double t, Eigen::Ref<Vector> phi) {
    for (Index i = 0; i < phi.size(); ++i) phi[i] = 0.02 * std::cos(3 * t - 0.1 * double(i));
  };
  scene.f_entry = SourceEntry::through_B;
  scene.x0 = Vector::NullaryExpr(
      r.states(), [&](Index i) { return 0.25 + 0.1 * std::sin(double(i % points) / 4) + 0.01 * double(i % 7); });
  scene.T = 1;
  return scene;
}

TEST(BothFaces, AreTheMatricesInModes) {
  for (const Index points : {24, 25})
    for (const EndCondition& ends : {EndCondition(dirichlet), EndCondition(neumann), EndCondition(2.)}) {
      const Rectangle r = two_sided(23, points, ends);
      const Dynamics modes(r), sparse(in_matrices(r));
      ASSERT_TRUE(holds<KroneckerDynamics>(modes));
      const SparseDynamics same = to_sparse(get<KroneckerDynamics>(modes)), &given = get<SparseDynamics>(sparse);
      EXPECT_LE(Matrix(same.A - given.A).cwiseAbs().maxCoeff(), 64 * epsilon * Matrix(given.A).cwiseAbs().maxCoeff());
      EXPECT_EQ(Matrix(same.B), Matrix(given.B));
      EXPECT_EQ(Matrix(same.N), Matrix(given.N));
      const Vector x = Vector::LinSpaced(r.states(), -1, 2).array().sin();
      EXPECT_LE((modes->observe(x) - sparse->observe(x)).cwiseAbs().maxCoeff(), 1e-14);
      EXPECT_LE((modes->observed_terms(x) - sparse->observed_terms(x)).cwiseAbs().maxCoeff(), 1e-14);
      // V diag(modal values) V^T is the resolvent. Condition numbers below 1e4.
      const ComplexVector nodes{{Complex(1, 2), Complex(-3, 40), Complex(200, 0)}};
      const HostThreads one;
      const ComplexMatrix values = modes->shifted_solves(nodes, one);
      const Matrix V = modes->modes()->face_basis().matrix();
      EXPECT_LE((V.transpose() * V - Matrix::Identity(46, 46)).cwiseAbs().maxCoeff(), 1e-13);
      for (Index p = 0; p < nodes.size(); ++p) {
        const ComplexMatrix shifted =
            nodes[p] * ComplexMatrix::Identity(r.states(), r.states()) - Matrix(given.A).cast<Complex>();
        const ComplexMatrix exact =
            Matrix(given.N).cast<Complex>() * shifted.partialPivLu().solve(Matrix(given.B).cast<Complex>());
        const ComplexMatrix found = V * values.row(p).asDiagonal() * V.transpose();
        EXPECT_LE((found - exact).cwiseAbs().maxCoeff(), 1e-11 * exact.cwiseAbs().maxCoeff()) << points << ' ' << p;
      }
    }
}

TEST(BothFaces, SidesThatDifferAreWrittenOut) {
  const auto in_modes = [](const Rectangle& r) { return holds<KroneckerDynamics>(Dynamics(r)); };
  const Rectangle r = two_sided(24, 24, neumann);
  EXPECT_TRUE(in_modes(r));
  Rectangle other = r;
  other.across.last = dirichlet;
  EXPECT_FALSE(in_modes(other));
  other = r;
  other.far_b *= 2;
  EXPECT_FALSE(in_modes(other));
  other = r;
  other.far_n[1] = 0;
  EXPECT_FALSE(in_modes(other));
  EXPECT_FALSE(in_modes(two_sided(20, 24, neumann))) << "480 states are dense";
  KroneckerDynamics d = *r.in_modes();
  d.across.last = 0;
  EXPECT_THROW(Dynamics(d)->validate(false), Error);
}

// Weights of both forms to 1e-12, which the sums over the steps and the constraint amplify below 1e4. 60 points are
// above the number for which exponentials are fitted; the other lines have all eigenvalues.
TEST(BothFaces, SolveWhatTheMatricesDo) {
  for (const auto& [lines, points] : {std::pair<Index, Index>{23, 25}, {11, 60}})
    for (const EndCondition& ends : {EndCondition(dirichlet), EndCondition(neumann), EndCondition(2.)})
      for (const double compliance : {0.0, 0.7})
        for (const Method method : {Method::march, Method::euler}) {
          if (method == Method::euler && compliance == 0) continue;
          Rectangle r = two_sided(lines, points, ends);
          r.n = r.far_n = Vector::Unit(points, 0);
          Options options = options_for(method, 64);
          options.states = StateSelection::list;
          options.components = {0, 5, points - 1, points * 7 + 3, points * lines - 1};
          options.trace = true;
          // Whether a step is taken by implicit Euler depends on how far the state moves, in its modes or its points.
          options.tuning.substitutes_euler = false;
          Scene scene = held_on_both(r, compliance), written = held_on_both(in_matrices(r), compliance);
          if (compliance == 0) scene.x0 = written.x0 = (written.x0.array() + 0.2).matrix();
          const Result modes = run(scene, options), sparse = run(written, options);
          ASSERT_EQ(modes.status, Status::solved) << modes.reason;
          ASSERT_EQ(sparse.status, Status::solved) << sparse.reason;
          const std::string what = modes.kernel + " / " + sparse.kernel;
          if (method == Method::march) {
            ASSERT_EQ(modes.continuous, sparse.continuous) << what;
          }
          EXPECT_GT((modes.y.array() > 0).count(), 50) << what;
          EXPECT_LE(distance(modes.y.bottomRows(64), sparse.y.bottomRows(64)), 1e-8 * sparse.y.maxCoeff()) << what;
          EXPECT_LE(distance(modes.x, sparse.x), 1e-8 * (1 + sparse.x.cwiseAbs().maxCoeff())) << what;
          EXPECT_LE(distance(modes.trace, sparse.trace), 1e-8 * (1 + sparse.trace.cwiseAbs().maxCoeff())) << what;
        }
}

// M with couplings along each side and none between them.
TEST(BothFaces, AllMethodsTakeThem) {
  for (const bool coupled : {false, true}) {
    Scene scene = held_on_both(two_sided(26, 21, neumann), 3);
    if (coupled) {
      Tridiagonal M{Vector::Constant(52, -0.5), Vector::Constant(52, 4), Vector::Constant(52, -0.5)};
      M.lower[26] = M.upper[25] = 0;
      scene.M = M;
    }
    const RowMatrix known = solved_y(scene, Method::march, 128);
    EXPECT_GT((known.array() > 0).count(), 100);
    for (const Method method : {Method::contour, Method::multigrid, Method::automatic})
      EXPECT_LE(distance(solved_y(scene, method, 128).bottomRows(128), known.bottomRows(128)), 1e-7 * known.maxCoeff())
          << to_string(method);
    Scene sparse = scene;
    sparse.dynamics = in_matrices(two_sided(26, 21, neumann));
    EXPECT_LE(distance(solved_y(sparse, Method::march, 128).bottomRows(128), known.bottomRows(128)),
              1e-8 * known.maxCoeff());
  }
}

class BothFacesOn : public BackendTest {};
INSTANTIATE_TEST_SUITE_P(Backends, BothFacesOn, testing::ValuesIn(backend_cases()), backend_case_name);

// Boxes, and a line: two constraints.
TEST_P(BothFacesOn, TakesBoxesAndLines) {
  Rectangle box = two_sided(5, 26, 0.5);
  box.beside = {points_with_ends(6, dirichlet, neumann)};
  Rectangle line = two_sided(1, 600, neumann);
  line.along.first = line.along.last = neumann;
  for (const Rectangle& r : {box, line}) {
    ASSERT_TRUE(holds<KroneckerDynamics>(Dynamics(r)));
    for (const Method method : {Method::march, Method::contour, Method::multigrid}) {
      const Scene modes = held_on_both(r, 4);
      const Result found = solve(modes, *backend, options_for(method, 48));
      ASSERT_EQ(found.status, Status::solved) << found.reason;
      const RowMatrix known = solved_y(held_on_both(in_matrices(r), 4), Method::march, 48);
      EXPECT_GT((known.array() > 0).count(), 10);
      EXPECT_LE(distance(found.y.bottomRows(48), known.bottomRows(48)), 1e-7 * known.maxCoeff()) << to_string(method);
    }
  }
}

// By f, g and x0 over all time points, and the gradient, beside those of the dense matrices. Contours are accepted at
// 1e-9 of the largest weight.
TEST(BothFaces, HaveDerivatives) {
  const Rectangle r = two_sided(23, 25, neumann);
  const Scene scene = held_on_both(r, 3);
  Scene dense = scene;
  dense.dynamics = to_dense(scene.dynamics);
  const Index J = 24, n = 46, m = r.states();
  const auto backend = make_cpu_backend(1);
  const Result result = solve(scene, *backend, options_for(Method::march, J));
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  SpaceTimeDerivative d(scene, result, *backend), known(dense, result, *backend);
  const auto drawn = [](Index rows, Index cols, double phase) {
    return RowMatrix::NullaryExpr(rows, cols,
                                  [=](Index i, Index j) { return std::sin(phase + double(7 * i + 3 * j)); });
  };
  DataChange c;
  c.x0 = drawn(m, 1, 0.1), c.f = drawn(J + 1, n, 0.2), c.g = drawn(J + 1, n, 0.3);
  const SolutionChange a = d.jvp(c, true), b = known.jvp(c, true);
  EXPECT_LE((a.y - b.y).norm(), 1e-8 * b.y.norm());
  EXPECT_LE((a.x - b.x).norm(), 1e-8 * b.x.norm());
  EXPECT_LE((a.w - b.w).norm(), 1e-8 * b.w.norm());
  SolutionChange of;
  of.y = drawn(J + 1, n, 0.4), of.x = drawn(J + 1, m, 0.5), of.w = drawn(J + 1, n, 0.6);
  const DataChange u = d.vjp(of), v = known.vjp(of);
  EXPECT_LE((u.x0 - v.x0).norm(), 1e-8 * v.x0.norm());
  EXPECT_LE((u.f - v.f).norm(), 1e-8 * v.f.norm());
  EXPECT_LE((u.g - v.g).norm(), 1e-8 * v.g.norm());
}

}  // namespace
}  // namespace bromwich

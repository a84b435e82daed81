// Shifted solves of boxes by the modes of their directions, against the elimination of the same matrices, and scenes
// solved with either.

#include "core/dynamics/grid_system.hpp"

#include "core/dynamics/dynamics.hpp"
#include "core/dynamics/rectangle.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

GridLine line(Index points, double advection, EndCondition first, EndCondition last) {
  return {points, GridLine::spacing_of(points, 1, first, last), 0.05, advection, first, last};
}

// Ends of all kinds, advection in both directions, two sides, 21 x 26 points.
Rectangle rectangle() {
  Rectangle r;
  r.along = line(21, 0.2, neumann, 1.5), r.across = line(26, -0.15, 0.7, neumann), r.reaction = 0.4;
  r.b = r.n = r.far_b = r.far_n = Vector::Zero(26);
  r.b[0] = 1 / r.across.spacing, r.far_b[0] = 2, r.n[0] = 1.5, r.n[1] = -0.5, r.far_n[0] = 1;
  return r;
}

Rectangle box() {
  Rectangle r;
  r.along = line(7, 0.1, neumann, neumann), r.beside = {line(8, 0, dirichlet, neumann)};
  r.across = line(11, 0, neumann, dirichlet);
  r.b = r.n = Vector::Unit(11, 0);
  return r;
}

const GridSystem& grid_of(const Dynamics& d) {
  const auto* grid = dynamic_cast<const GridSystem*>(&*d);
  if (!grid) throw Error("dynamics", "are no grid", "");
  return *grid;
}

ComplexVector nodes() {
  ComplexVector z(9);
  for (Index i = 0; i < z.size(); ++i) z[i] = std::polar(std::pow(10, -1 + 0.5 * double(i)), 0.3 * double(i));
  return z;
}

// Of the largest entry. Both are accurate to the rounding of a condition number below 1e3.
double difference(const LinearSystem& a, const LinearSystem& b) {
  const ComplexMatrix of_a = a.shifted_solves(nodes(), HostThreads()), of_b = b.shifted_solves(nodes(), HostThreads());
  return (of_a - of_b).cwiseAbs().maxCoeff<Eigen::PropagateNaN>() / of_b.cwiseAbs().maxCoeff();
}

constexpr double same = 1e-11;

TEST(GridSystem, SolvesWhatTheEliminationDoes) {
  for (const Rectangle& r : {rectangle(), box()}) {
    const Dynamics d(r);
    const GridSystem& grid = grid_of(d);
    ASSERT_TRUE(grid.solves_in_modes());
    EXPECT_LE(difference(grid, *linear_system(grid.d)), same);
    // Beside the contacts: sources that enter few and all states, x0, and two states that are seen.
    const Index m = r.states(), n = grid.d.B.cols();
    Matrix B(m, n + 3), N(n + 2, m);
    B << Matrix(grid.d.B), Vector::Unit(m, 30), Vector::Ones(m),
        Vector::NullaryExpr(m, [](Index i) { return std::cos(double(i * i)); });
    N << Matrix(grid.d.N), Vector::Unit(m, 0).transpose(), Vector::Unit(m, m / 2).transpose();
    const SparseMatrix wide_B = B.sparseView(), wide_N = N.sparseView();
    const auto wide = grid.with_inputs_and_outputs(wide_B, wide_N);
    ASSERT_TRUE(dynamic_cast<const GridSystem&>(*wide).solves_in_modes());
    EXPECT_LE(difference(*wide, *linear_system(SparseDynamics{grid.d.A, wide_B, wide_N})), same);
  }
}

TEST(GridSystem, KeepsItsModesInOtherUnits) {
  const Dynamics d(rectangle());
  const GridSystem& grid = grid_of(d);
  const Vector unit = Vector::NullaryExpr(d->states(), [](Index i) { return std::pow(10, double(i % 3 - 1)); });
  const auto scale = [](const SparseMatrix& M, const Vector& left, const Vector& right) {
    return SparseMatrix(left.asDiagonal() * M * right.asDiagonal());
  };
  const Vector one = Vector::Ones(grid.d.B.cols()), per = unit.cwiseInverse();
  const SparseDynamics scaled{scale(grid.d.A, per, unit), scale(grid.d.B, per, one), scale(grid.d.N, one, unit)};
  const auto in_units = grid.in_units(scaled, unit);
  ASSERT_TRUE(dynamic_cast<const GridSystem&>(*in_units).solves_in_modes());
  EXPECT_LE(difference(*in_units, *linear_system(scaled)), same);
  EXPECT_LE(difference(*in_units, grid), same) << "N (zI - A)^{-1} B has no unit of x";
}

// A is the user's to change: the modes are then those of another matrix, and the known column says so.
TEST(GridSystem, AChangedMatrixIsEliminated) {
  const Dynamics given(rectangle());
  SparseDynamics changed = grid_of(given).d;
  changed.A.coeffRef(40, 40) -= 3;
  const GridSystem stale(changed, GridModes::of({rectangle().along.matrix(), rectangle().across.matrix()}, 0.4));
  EXPECT_LE(difference(stale, *linear_system(changed)), same);
  EXPECT_GT(difference(stale, *linear_system(grid_of(given).d)), 1e-4);
}

TEST(GridSystem, ObliqueEigenvectorsAreNotTaken) {
  GridLine along = line(101, 0, dirichlet, dirichlet);
  const auto modes = [&along](double advection) {
    along.advection = advection;
    return GridModes::of({along.matrix(), line(10, 0, neumann, neumann).matrix()}, 0);
  };
  EXPECT_TRUE(modes(0.9)) << "e^{v/(2c)} = 8e3";
  EXPECT_FALSE(modes(1.5)) << "3e6";
}

TEST(GridSystem, WideContactsAreEliminated) {
  Rectangle r = rectangle();
  r.b = r.n = Vector::Ones(26);
  const Dynamics d(r);
  EXPECT_FALSE(grid_of(d).solves_in_modes());
  EXPECT_EQ(difference(grid_of(d), *linear_system(grid_of(d).d)), 0);
}

// y, w of the scene and of its matrices. Poles are picked from values that agree to 1e-11; those that differ change
// both kernels by their error, below 1e-9, which 64 steps of a march with M = 0 amplify below 1e3.
TEST(GridSystem, ScenesAreThoseOfTheirMatrices) {
  for (const double compliance : {0.0, 0.1}) {
    Scene scene;
    scene.dynamics = rectangle();
    const Index n = scene.dynamics->constraints();
    scene.M = Tridiagonal{Vector::Zero(n), Vector::Constant(n, compliance), Vector::Zero(n)};
    scene.g = [n](double t, Eigen::Ref<Vector> g) {
      for (Index i = 0; i < n; ++i) g[i] = 0.03 * std::sin(4 * t + 0.2 * double(i)) - 0.01;
    };
    scene.x0 = Vector::NullaryExpr(scene.states(), [](Index i) { return 0.02 * std::cos(double(i) / 9); });
    scene.T = 1;
    Scene written = scene;
    written.dynamics = grid_of(scene.dynamics).d;
    Options options = options_for(Method::march, 700);
    options.states = StateSelection::list;
    options.components = {0, 5, 300};
    const Result modes = run(scene, options), matrices = run(written, options);
    ASSERT_EQ(modes.status, Status::solved) << modes.reason;
    ASSERT_EQ(matrices.status, Status::solved) << matrices.reason;
    EXPECT_GT((modes.y.array() > 0).count(), 1000) << modes.kernel;
    EXPECT_LE((modes.y - matrices.y).bottomRows(700).cwiseAbs().maxCoeff<Eigen::PropagateNaN>(),
              1e-6 * modes.y.maxCoeff())
        << modes.kernel << " / " << matrices.kernel;
    EXPECT_LE((modes.x - matrices.x).cwiseAbs().maxCoeff<Eigen::PropagateNaN>(), 1e-6) << compliance;
  }
}

}  // namespace
}  // namespace bromwich

// The linear systems of Radau IIA against a factorization of the whole system of s m unknowns.

#include "core/events/stage_systems.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include <cmath>
#include <random>

namespace bromwich {
namespace {

constexpr Index s = StageSystems::degree;

Matrix stage_matrix() {
  const Collocation& c = Collocation::get();
  return c.integrals.leftCols(s) * c.stages.leftCols(s).inverse();
}

// (I - h 𝒜 ⊗ A) X = R, stage by stage.
Matrix by_whole_system(const Matrix& A, double h, const Matrix& right) {
  const Index m = A.rows();
  const Matrix stages = stage_matrix();
  Matrix whole = Matrix::Identity(s * m, s * m);
  for (Index i = 0; i < s; ++i)
    for (Index j = 0; j < s; ++j) whole.block(i * m, j * m, m, m) -= h * stages(i, j) * A;
  const Matrix transposed = right.transpose();
  const Vector x = whole.fullPivLu().solve(Vector(transposed.reshaped()));
  return x.reshaped(m, s).transpose();
}

Matrix random_matrix(Index rows, Index columns, std::mt19937& random) {
  std::normal_distribution<double> normal;
  return Matrix::NullaryExpr(rows, columns, [&] { return normal(random); });
}

TEST(StageSystems, SolveWhatTheWholeSystemSolves) {
  std::mt19937 random(7);
  for (const Index m : {1, 2, 3, 4, 7, 12}) {
    const Matrix A = random_matrix(m, m, random);
    StageSystems systems(A);
    for (const double h : {1e-3, 0.3, 1.0, 40.0, 0.3}) {
      const StageSystems::AtStages right = random_matrix(s, m, random);
      StageSystems::AtStages x;
      systems.solve(h, right, x);
      const Matrix known = by_whole_system(A, h, right);
      EXPECT_LE((x - known).norm(), 1e-10 * known.norm()) << m << " states, h = " << h;
    }
  }
}

// A ladder of rates over twelve decades, in units that differ by as much: the residual is small for every component
// after one refinement with A itself, as collocation does.
TEST(StageSystems, RefinedSolutionsAreRightInEveryComponent) {
  std::mt19937 random(3);
  constexpr Index m = 9;
  Matrix A = Matrix::Zero(m, m);
  for (Index i = 0; i < m; ++i) A(i, i) = -std::pow(10.0, 1.5 * double(i));
  for (Index i = 0; i + 1 < m; ++i) A(i, i + 1) = 0.1 * A(i, i), A(i + 1, i) = 0.1 * A(i, i);
  const Vector units = Vector::NullaryExpr(m, [](Index i) { return std::pow(10.0, i % 2 == 0 ? 6 : -6); });
  A = units.asDiagonal() * A * units.cwiseInverse().asDiagonal();
  StageSystems systems(A);
  const Matrix stages = stage_matrix();
  for (const double h : {1e-9, 1e-4, 1.0}) {
    const StageSystems::AtStages right = random_matrix(s, m, random) * units.asDiagonal();
    StageSystems::AtStages x, correction;
    systems.solve(h, right, x);
    systems.solve(h, right - x + h * stages * x * A.transpose(), correction);
    x += correction;
    const Matrix off = right - x + h * stages * x * A.transpose();
    const Matrix terms =
        right.cwiseAbs() + x.cwiseAbs() + h * stages.cwiseAbs() * x.cwiseAbs() * A.cwiseAbs().transpose();
    EXPECT_LE((off.array() / terms.array()).abs().maxCoeff(), 1e-14) << h;
  }
}

// Two blocks, one of which drives the other, and a state apart: what is at rest stays so, beside large values.
TEST(StageSystems, StatesAtRestStayFreeOfTheRoundingOfOthers) {
  std::mt19937 random(5);
  constexpr Index m = 7;
  const Matrix all = random_matrix(m, m, random);
  Matrix A = Matrix::Zero(m, m);
  A.topLeftCorner(3, 3) = all.topLeftCorner(3, 3);  // drives the next
  A.block(3, 0, 3, 6) = all.block(3, 0, 3, 6);
  Eigen::PermutationMatrix<Eigen::Dynamic> order(m);
  order.indices() << 4, 0, 6, 2, 5, 1, 3;
  A = order * A * order.transpose();
  StageSystems::AtStages right = random_matrix(s, m, random), x;
  for (const Index at_rest : {4, 0, 6, 3}) right.col(at_rest).setZero();
  StageSystems systems(A);
  systems.solve(0.7, right, x);
  const Matrix known = by_whole_system(A, 0.7, right);
  EXPECT_LE((x - known).norm(), 1e-12 * known.norm());
  for (const Index at_rest : {4, 0, 6, 3}) EXPECT_TRUE(x.col(at_rest).isZero(0)) << at_rest;
}

TEST(StageSystems, TakesNoStates) {
  StageSystems systems{Matrix(0, 0)};
  StageSystems::AtStages right(s, 0), x;
  systems.solve(1, right, x);
  EXPECT_EQ(x.cols(), 0);
}

}  // namespace
}  // namespace bromwich

// Sparse M: classes, active sets and batches of sweeps against the dense solvers.

#include "core/base/error.hpp"
#include "core/lcp/sparse_lcp.hpp"
#include "core/seam/backend.hpp"
#include "cpu/cpu_backend.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace bromwich {
namespace {

// The 5-point (layers = 1) or 7-point matrix with `shift` added to its diagonal and `skew` to one side of it.
SparseMatrix stencil(Index G, Index layers, double shift, double skew = 0) {
  std::vector<Eigen::Triplet<double>> entries;
  const auto id = [G](Index i, Index j, Index k) { return (k * G + i) * G + j; };
  for (Index k = 0; k < layers; ++k)
    for (Index i = 0; i < G; ++i)
      for (Index j = 0; j < G; ++j) {
        const Index r = id(i, j, k);
        entries.emplace_back(r, r, (layers > 1 ? 6 : 4) + shift);
        const auto to = [&](bool inside, Index c) {
          if (inside) entries.emplace_back(r, c, c > r ? -1 + skew : -1 - skew);
        };
        to(i > 0, r - G);
        to(i + 1 < G, r + G);
        to(j > 0, r - 1);
        to(j + 1 < G, r + 1);
        to(k > 0, r - G * G);
        to(k + 1 < layers, r + G * G);
      }
  SparseMatrix M(G * G * layers, G * G * layers);
  M.setFromTriplets(entries.begin(), entries.end());
  return M;
}

// Symmetric positive definite with entries of both signs off the diagonal, not dominant: not H+.
SparseMatrix plate_of_springs(Index n) {
  std::vector<Eigen::Triplet<double>> entries;
  for (Index i = 0; i < n; ++i) {
    entries.emplace_back(i, i, 6.5);
    if (i > 0) entries.emplace_back(i, i - 1, -4), entries.emplace_back(i - 1, i, -4);
    if (i > 1) entries.emplace_back(i, i - 2, 1), entries.emplace_back(i - 2, i, 1);
  }
  SparseMatrix M(n, n);
  M.setFromTriplets(entries.begin(), entries.end());
  return M;
}

Vector random_vector(Index n, unsigned seed) {
  std::mt19937 engine(seed);
  std::normal_distribution<double> normal;
  return Vector::NullaryExpr(n, [&](Index) { return normal(engine); });
}

// By the dense active-set solver, which shares no code with the sweeps.
Vector dense_solution(const SparseMatrix& M, const Vector& q) {
  ActiveSetLcp solver(Matrix(M), LcpClass::P);
  Vector y;
  EXPECT_TRUE(solver.solve(q, y).solved);
  return y;
}

TEST(SparseLcp, ClassesAreTested) {
  EXPECT_EQ(plan_sweeps(stencil(8, 1, 0)).why, "symmetric positive definite");
  EXPECT_EQ(plan_sweeps(stencil(4, 4, 0.1)).why, "symmetric positive definite");
  EXPECT_EQ(plan_sweeps(stencil(8, 1, 0.1, 0.4)).why, "H+");
  EXPECT_EQ(plan_sweeps(plate_of_springs(40)).why, "symmetric positive definite");
  EXPECT_FALSE(plan_sweeps(stencil(8, 1, -1)).converges);    // indefinite
  EXPECT_FALSE(plan_sweeps(stencil(8, 1, 0, 3)).converges);  // far from dominant, not symmetric
  EXPECT_FALSE(plan_sweeps(SparseMatrix(5, 5)).converges);   // M = 0
  EXPECT_NE(plan_sweeps(SparseMatrix(5, 5)).why.find("diagonal entry 0"), std::string::npos);
  EXPECT_TRUE(plan_sweeps(SparseMatrix(0, 0)).converges);
}

TEST(SparseLcp, TheClassOfASparseMatrixIsThatOfTheDenseOne) {
  for (const SparseMatrix& M : {stencil(5, 1, 0), stencil(5, 1, 0, 0.3), stencil(5, 1, -1), plate_of_springs(25),
                                stencil(5, 1, 0, 3), SparseMatrix(7, 7)}) {
    const LcpMatrix sparse = SparseLcpMatrix(M), dense = Matrix(M);
    EXPECT_EQ(classify(sparse), classify(dense));
    EXPECT_EQ(is_Z(sparse), is_Z(dense));
    EXPECT_EQ(is_PSD(sparse), is_PSD(dense));
    EXPECT_EQ(contradiction(sparse, LcpClass::P), contradiction(dense, LcpClass::P));
  }
}

TEST(SparseLcp, ActiveSetsFindTheSolution) {
  for (const SparseMatrix& M : {stencil(7, 1, 0), stencil(3, 3, 0), stencil(7, 1, 0.1, 0.4)}) {
    const SparseMatrix kept = M;
    SparseActiveSet solver(kept);
    const Vector q = random_vector(M.rows(), 3);
    Vector y = Vector::Zero(M.rows());
    ASSERT_TRUE(solver.solve(q, y).solved);
    // Both solve M_SS y_S = -q_S; the condition is below 4 / (2 - 2 cos(pi/8)) = 26.
    EXPECT_LE((y - dense_solution(M, q)).cwiseAbs().maxCoeff(), 1e3 * epsilon * 26);
  }
}

TEST(SparseLcp, BatchesOfSweepsAreExact) {
  const auto backend = make_cpu_backend(2);
  for (const SparseMatrix& M :
       {stencil(9, 1, 0), stencil(5, 5, 0), stencil(9, 1, 0.1, 0.4), plate_of_springs(60), stencil(1, 1, 0)}) {
    const Index n = M.rows(), rows = 19;
    RowMatrix r(rows, n), y0 = RowMatrix::Zero(rows, n);
    for (Index j = 0; j < rows; ++j) r.row(j) = random_vector(n, unsigned(j)).transpose();
    const auto R = backend->array(rows, n), V = backend->array(rows, n), Y = backend->array(rows, n);
    backend->upload(r, *R);
    backend->upload(y0, *Y);
    const auto batch = backend->lcp(SparseLcpMatrix(M), LcpClass::automatic, rows);
    const LcpReport report = batch->solve(*R, *V, *Y, 0);
    EXPECT_EQ(report.count.solved, rows);
    EXPECT_EQ(report.count.unsolved, 0);
    RowMatrix y;
    backend->download(*Y, y);
    EXPECT_LE(batch->residual(*R, *V, *Y), 1e-13);
    const double condition = plan_sweeps(M).radius < 1 ? 2 / (1 - plan_sweeps(M).radius) : 1e4;
    for (Index j = 0; j < rows; ++j)
      EXPECT_LE((y.row(j).transpose() - dense_solution(M, r.row(j).transpose())).cwiseAbs().maxCoeff(),
                100 * condition * epsilon * y.row(j).maxCoeff() + 1e-14)
          << n;
  }
}

TEST(SparseLcp, WhatTheSweepsDoNotSolveIsSaid) {
  const auto backend = make_cpu_backend(1);
  const SparseMatrix large = stencil(20, 1, 0, 3);
  const auto R = backend->array(3, 400), V = backend->array(3, 400), Y = backend->array(3, 400);
  backend->upload(RowMatrix(RowMatrix::Constant(3, 400, -1)), *R);
  const auto batch = backend->lcp(SparseLcpMatrix(large), LcpClass::automatic, 3);
  try {
    batch->solve(*R, *V, *Y, 0);
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("neither symmetric positive definite nor H+"), std::string::npos);
  }
  // A small one has the fallbacks of dense matrices.
  const SparseMatrix small = stencil(4, 1, 0, 3);
  EXPECT_NO_THROW(backend->lcp(SparseLcpMatrix(small), LcpClass::automatic, 3));
}

TEST(SparseLcp, RowsThatAreNotFiniteAreReported) {
  const auto backend = make_cpu_backend(1);
  const SparseMatrix M = stencil(5, 1, 0);
  RowMatrix r = RowMatrix::Constant(10, 25, -1);
  r(4, 7) = NAN;
  const auto R = backend->array(10, 25), V = backend->array(10, 25), Y = backend->array(10, 25);
  backend->upload(r, *R);
  const LcpReport report = backend->lcp(SparseLcpMatrix(M), LcpClass::P, 10)->solve(*R, *V, *Y, 0);
  EXPECT_FALSE(report.finite);
  EXPECT_EQ(report.count.unsolved, 1);
}

}  // namespace
}  // namespace bromwich

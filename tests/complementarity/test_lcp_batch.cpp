// Complementarity problems of every class against an enumeration of all active sets, larger ones by their residual.

#include "bromwich/lcp_batch.hpp"
#include "core/base/error.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/lcp/solution.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/lcp_oracle.hpp"
#include "tests/support/random_draws.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>
#include <Eigen/QR>

#include <cmath>

namespace bromwich {
namespace {

using reference::Random;

Matrix random_matrix(Random& random, Index n) {
  return Matrix(Matrix::NullaryExpr(n, n, [&random] { return random.uniform(-1, 1); }));
}

RowMatrix random_rows(Random& random, Index count, Index n) {
  return RowMatrix(RowMatrix::NullaryExpr(count, n, [&random] { return random.uniform(-1, 1); }));
}

/// Definite and not symmetric: class P.
Matrix random_P(Random& random, Index n) {
  const Matrix L = random_matrix(random, n), K = random_matrix(random, n);
  return L * L.transpose() + (K - K.transpose()) + 0.1 * Matrix::Identity(n, n);
}

Matrix random_Z(Random& random, Index n) {
  Matrix M = -random_matrix(random, n).cwiseAbs();
  M.diagonal() = Vector::NullaryExpr(n, [&random] { return random.uniform(0.2, double(2)); });
  return M;
}

/// Whether some active set with a regular M_SS solves it, and the solutions.
std::vector<Vector> regular_solutions(const Matrix& M, const Vector& q) {
  const Index n = q.size();
  std::vector<Vector> found;
  for (unsigned set = 0; set < 1u << n; ++set) {
    const std::vector<Index> S = members(set, n);
    Vector y = Vector::Zero(n);
    if (!S.empty()) {
      const Eigen::ColPivHouseholderQR<Matrix> qr(Matrix(M(S, S)));
      if (qr.rank() < Index(S.size())) continue;
      y(S) = qr.solve(Vector(-q(S)));
    }
    const Vector w = M * y + q;
    if (y.minCoeff() >= -1e-10 && w.minCoeff() >= -1e-10 && y.cwiseMin(w).cwiseAbs().maxCoeff() < 1e-9)
      found.push_back(y);
  }
  return found;
}

// Rounding of a problem of n <= 8 with entries of size 1 and inverses up to 1e4.
constexpr double rounding = 1e-9;

TEST(LcpBatch, PIsTheOnlySolution) {
  Random random(1);
  const auto backend = make_cpu_backend();
  for (Index n = 1; n <= 8; ++n) {
    const Matrix M = random_P(random, n);
    const RowMatrix q = random_rows(random, 37, n);
    const LcpBatchResult shared = lcp_batch(LcpMatrix(M), q, *backend);
    const LcpBatchResult own = lcp_batch(std::vector<Matrix>(37, M), q, *backend);
    EXPECT_EQ(shared.classes[0], LcpClass::P);
    ASSERT_EQ(shared.solved(), 37);
    ASSERT_EQ(own.solved(), 37);
    for (Index k = 0; k < 37; ++k) {
      const std::vector<Vector> exact = regular_solutions(M, q.row(k));
      ASSERT_FALSE(exact.empty());
      for (const LcpBatchResult* r : {&shared, &own}) {
        EXPECT_LE((r->y.row(k).transpose() - exact[0]).cwiseAbs().maxCoeff(),
                  rounding * (1 + exact[0].cwiseAbs().maxCoeff()));
        EXPECT_LE(r->residual[k], 1e-12);
        EXPECT_EQ(r->y.row(k).cwiseProduct(r->w.row(k)).cwiseAbs().maxCoeff(), 0);
      }
    }
  }
}

TEST(LcpBatch, ZIsTheLeastSolutionOrInfeasible) {
  Random random(2);
  const auto backend = make_cpu_backend();
  Index infeasible = 0;
  for (Index n = 1; n <= 6; ++n)
    for (int trial = 0; trial < 10; ++trial) {
      const Matrix M = random_Z(random, n);
      const RowMatrix q = random_rows(random, 8, n);
      const LcpBatchResult result = lcp_batch(LcpMatrix(M), q, *backend, {.lcp_class = LcpClass::Z, .start = {}});
      for (Index k = 0; k < 8; ++k) {
        const std::vector<Vector> all = regular_solutions(M, q.row(k));
        if (result.status[std::size_t(k)] == LcpStatus::infeasible) {
          EXPECT_TRUE(all.empty());
          ++infeasible;
          continue;
        }
        ASSERT_EQ(result.status[std::size_t(k)], LcpStatus::solved);
        for (const Vector& y : all)
          EXPECT_LE((result.y.row(k).transpose() - y).maxCoeff(), rounding * (1 + y.maxCoeff()));
      }
    }
  EXPECT_GT(infeasible, 10);
}

TEST(LcpBatch, PSDIsTheSolutionOfLeastNorm) {
  Random random(3);
  const auto backend = make_cpu_backend();
  for (Index n = 2; n <= 6; ++n)
    for (int kind = 0; kind < 4; ++kind) {
      const auto p = oracle::random_monotone(random, n, kind);
      if (is_Z(p.M)) continue;
      const LcpBatchResult result =
          lcp_batch(LcpMatrix(p.M), RowMatrix(p.q.transpose()), *backend, {.lcp_class = LcpClass::PSD, .start = {}});
      ASSERT_EQ(result.status[0], LcpStatus::solved);
      const Vector exact = oracle::least_norm(p.M, p.q, p.known);
      EXPECT_LE((result.y.row(0).transpose() - exact).cwiseAbs().maxCoeff(), 1e-7 * (1 + exact.norm()));
    }
  const LcpBatchResult none = lcp_batch(LcpMatrix(Matrix(Matrix::Zero(2, 2))), RowMatrix{{-1, 1}, {1, 2}}, *backend);
  EXPECT_EQ(none.status[0], LcpStatus::infeasible);
  EXPECT_EQ(none.status[1], LcpStatus::solved);
}

// Any class: what is solved is a solution, what is infeasible has none among all active sets.
TEST(LcpBatch, UnknownClassesAreCertified) {
  Random random(4);
  const auto backend = make_cpu_backend();
  Index solved = 0, infeasible = 0;
  for (Index n = 1; n <= 7; ++n)
    for (int trial = 0; trial < 12; ++trial) {
      const Matrix M = random_matrix(random, n);
      const RowMatrix q = random_rows(random, 4, n);
      for (const LcpBatchResult& r :
           {lcp_batch(LcpMatrix(M), q, *backend, {.lcp_class = LcpClass::unknown, .start = {}}),
            lcp_batch(std::vector<Matrix>(4, M), q, *backend)})
        for (Index k = 0; k < 4; ++k) {
          const bool any = !regular_solutions(M, q.row(k)).empty();
          if (r.status[std::size_t(k)] == LcpStatus::solved) {
            const Vector y = r.y.row(k), w = M * y + q.row(k).transpose();
            EXPECT_GE(y.minCoeff(), 0);
            EXPECT_LE(y.cwiseMin(w).cwiseAbs().maxCoeff(), 1e-9 * (1 + y.maxCoeff()));
            ++solved;
          } else {
            EXPECT_EQ(r.status[std::size_t(k)], LcpStatus::infeasible);
            EXPECT_FALSE(any);
            ++infeasible;
          }
        }
    }
  EXPECT_GT(solved, 50);
  EXPECT_GT(infeasible, 20);
}

// Units of rows and columns from 1e-12 to 1e12, and other orders of the unknowns, change nothing else.
TEST(LcpBatch, UnitsAndOrderDoNotMatter) {
  Random random(5);
  const auto backend = make_cpu_backend();
  for (const Index n : {3, 8, 16, 17, 40}) {
    const Matrix M = random_P(random, n);
    const RowMatrix q = random_rows(random, 10, n);
    const LcpBatchResult plain = lcp_batch(LcpMatrix(M), q, *backend);
    Vector rows(n), columns(n);
    for (Index i = 0; i < n; ++i)
      rows[i] = std::pow(10, 12 * random.uniform(-1, 1)), columns[i] = std::pow(10, 12 * random.uniform(-1, 1));
    const Matrix scaled = rows.asDiagonal() * M * columns.asDiagonal();
    const RowMatrix other = q * rows.asDiagonal();
    const LcpBatchResult result =
        lcp_batch(LcpMatrix(scaled), other, *backend, {.lcp_class = LcpClass::P, .start = {}});
    ASSERT_EQ(result.solved(), 10);
    EXPECT_LE((result.y * columns.asDiagonal() - plain.y).cwiseAbs().maxCoeff(), 1e-8 * (1 + plain.y.maxCoeff()));
    Eigen::PermutationMatrix<Eigen::Dynamic> order(n);
    order.setIdentity();
    for (Index i = 0; i < n; ++i) order.indices()[i] = int(n - 1 - i);
    const LcpBatchResult turned =
        lcp_batch(LcpMatrix(Matrix(order * M * order.transpose())), RowMatrix(q * order.transpose()), *backend);
    EXPECT_LE((turned.y * order - plain.y).cwiseAbs().maxCoeff(), 1e-8 * (1 + plain.y.maxCoeff()));
  }
}

TEST(LcpBatch, SizesAndFormsOfMatrices) {
  Random random(6);
  const auto backend = make_cpu_backend();
  for (const Index n : {1, 16, 17, 64, 300}) {
    Tridiagonal t{Vector::Constant(n, -1), Vector::Constant(n, 2.2), Vector::Constant(n, -1)};
    const Matrix dense = to_dense(LcpMatrix(t));
    const RowMatrix q = random_rows(random, 5, n);
    const LcpBatchResult expected = lcp_batch(LcpMatrix(dense), q, *backend);
    ASSERT_EQ(expected.solved(), 5);
    EXPECT_LE(expected.residual.maxCoeff(), 1e-13);
    for (const LcpMatrix& M : {LcpMatrix(t), LcpMatrix(SparseLcpMatrix(dense.sparseView()))}) {
      const LcpBatchResult r = lcp_batch(M, q, *backend);
      ASSERT_EQ(r.solved(), 5) << n;
      EXPECT_LE((r.y - expected.y).cwiseAbs().maxCoeff(), 1e-10);
      EXPECT_LE((r.w - expected.w).cwiseAbs().maxCoeff(), 1e-10);
    }
  }
  const LcpBatchResult large = lcp_batch(LcpMatrix(random_P(random, 1024)), random_rows(random, 1, 1024), *backend,
                                         {.lcp_class = LcpClass::P, .start = {}});
  EXPECT_EQ(large.solved(), 1);
  EXPECT_LE(large.residual[0], 1e-10);
  const LcpBatchResult none = lcp_batch(LcpMatrix(Matrix(0, 0)), RowMatrix(3, 0), *backend);
  EXPECT_EQ(none.solved(), 3);
  EXPECT_EQ(lcp_batch(LcpMatrix(Matrix{{1}}), RowMatrix(0, 1), *backend).y.rows(), 0);
  EXPECT_EQ(lcp_batch(std::vector<Matrix>(), RowMatrix(0, 1), *backend).y.rows(), 0);
}

TEST(LcpBatch, StartsAtTheSolutionTakeOneActiveSet) {
  Random random(7);
  const auto backend = make_cpu_backend();
  const Matrix M = random_P(random, 30);
  const RowMatrix q = random_rows(random, 20, 30);
  const LcpBatchResult cold = lcp_batch(LcpMatrix(M), q, *backend);
  const LcpBatchResult warm = lcp_batch(LcpMatrix(M), q, *backend, {.lcp_class = LcpClass::P, .start = cold.y});
  EXPECT_LE((warm.y - cold.y).cwiseAbs().maxCoeff(), 1e-10);
  for (const Index iterations : warm.iterations) EXPECT_EQ(iterations, 1);
}

TEST(LcpBatch, MarginShowsDegenerateProblems) {
  const auto backend = make_cpu_backend();
  const LcpBatchResult r = lcp_batch(LcpMatrix(Matrix(Matrix::Identity(2, 2))), RowMatrix{{-1, 0}, {-1, 1}}, *backend);
  EXPECT_LE(r.margin[0], 1e-15);
  EXPECT_GE(r.margin[1], 0.5);
}

TEST(LcpBatch, BadInput) {
  const auto backend = make_cpu_backend();
  const RowMatrix q = RowMatrix::Ones(2, 2);
  const Matrix I = Matrix::Identity(2, 2);
  EXPECT_THROW(lcp_batch(LcpMatrix(Matrix(Matrix::Ones(2, 3))), q, *backend), Error);
  EXPECT_THROW(lcp_batch(LcpMatrix(Matrix(Matrix::Identity(3, 3))), q, *backend), Error);
  EXPECT_THROW(lcp_batch(LcpMatrix(Matrix(NAN * I)), q, *backend), Error);
  EXPECT_THROW(lcp_batch(LcpMatrix(Matrix(-I)), q, *backend, {.lcp_class = LcpClass::P, .start = {}}), Error);
  EXPECT_THROW(lcp_batch(LcpMatrix(I), q, *backend, {.lcp_class = LcpClass::P, .start = RowMatrix::Ones(1, 2)}), Error);
  EXPECT_THROW(lcp_batch(std::vector<Matrix>(3, I), q, *backend), Error);
  EXPECT_THROW(lcp_batch(std::vector<Matrix>(2, Matrix::Ones(2, 3)), q, *backend), Error);
  const LcpBatchResult r = lcp_batch(LcpMatrix(I), RowMatrix{{1, NAN}, {-1, 1}}, *backend);
  EXPECT_EQ(r.status[0], LcpStatus::nonfinite);
  EXPECT_EQ(r.status[1], LcpStatus::solved);
  EXPECT_EQ(r.y(1, 0), 1);
}

}  // namespace
}  // namespace bromwich

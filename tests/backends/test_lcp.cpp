// Contract of Backend: batches of complementarity problems, row by row against other solvers.

#include "core/lcp/active_set.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/oracle.hpp"

#include <Eigen/Dense>

namespace bromwich {
namespace {

using reference::Random;

class BackendLcp : public BackendTest {
 protected:
  /// Solves with q = r + v split at random.
  LcpReport solve(LcpBatch& lcp, const RowMatrix& q, RowMatrix& y, Index first = 0, double settle = 0) {
    const RowMatrix part = Random(77).matrix(q.rows(), q.cols());
    const auto r = device(q - part), v = device(part), out = device(y);
    const LcpReport report = lcp.solve(*r, *v, *out, first, settle);
    y = host(*out);
    residual = lcp.residual(*r, *v, *out);
    return report;
  }
  double residual = 0;  ///< after the last solve
};

INSTANTIATE_TEST_SUITE_P(Contract, BackendLcp, testing::ValuesIn(backend_cases()), backend_case_name);

Tridiagonal random_tridiagonal(Random& random, Index n) {
  Tridiagonal M{random.vector(n), Vector(n), random.vector(n)};
  for (Index i = 0; i < n; ++i)
    M.diagonal[i] =
        (i > 0 ? std::abs(M.lower[i]) : 0) + (i + 1 < n ? std::abs(M.upper[i]) : 0) + random.uniform(0.1, 2);
  return M;
}

/// Enumeration up to 8 constraints, the pivoting solver from an empty set above.
Vector solved_alone(const Matrix& M, const Vector& q, LcpClass c) {
  if (M.rows() <= 8) return *oracle::solve_lcp(M, q, c);
  Vector y;
  EXPECT_TRUE(ActiveSetLcp(M, c).solve(q, y).solved);
  return y;
}

/// ||M^{-1}|| < 10 n for margins of dominance from 0.1; roundings of n terms of size 1, and q is r + v with a rounding.
double tolerance(Index n) { return 64 * epsilon * 10 * double(n) * double(n); }

TEST_P(BackendLcp, RowsAgainstOtherSolvers) {
  for (const Index n : {1, 2, 3, 8, 16, 17, 33})
    for (const bool dense : {false, true})
      for (const Index rows : {1, 7, 50}) {
        Random random{std::uint32_t(n)};
        const LcpMatrix M = dense ? LcpMatrix(random.dominant(n)) : LcpMatrix(random_tridiagonal(random, n));
        const Matrix written = to_dense(M);
        const RowMatrix q = random.matrix(rows, n);
        RowMatrix y = random.matrix(rows, n).cwiseMax(0);  // any start
        const RowMatrix before = y;
        const auto lcp = backend->lcp(M, LcpClass::P, rows);
        const LcpReport report = solve(*lcp, q, y);
        for (Index j = 0; j < rows; ++j)
          EXPECT_LE((y.row(j).transpose() - solved_alone(written, q.row(j), LcpClass::P)).cwiseAbs().maxCoeff(),
                    tolerance(n))
              << n << (dense ? " dense" : " tridiagonal") << ", row " << j;
        EXPECT_EQ(report.count.solved, rows);
        EXPECT_EQ(report.count.unsolved, 0);
        EXPECT_GE(report.count.newton, rows);
        EXPECT_EQ(report.infeasible, -1);
        EXPECT_TRUE(report.finite);
        double change = 0;
        for (Index j = 0; j < rows; ++j)
          change =
              std::max(change, (y.row(j) - before.row(j)).cwiseAbs().maxCoeff() / std::max(1.0, y.row(j).maxCoeff()));
        EXPECT_NEAR(report.change, change, 1e-14);
        EXPECT_NEAR(report.magnitude, y.maxCoeff(), 1e-14);
        EXPECT_LE(residual, 64 * epsilon * double(n) * (1 + written.cwiseAbs().maxCoeff() * y.maxCoeff())) << n;

        const LcpReport again = solve(*lcp, q, y);  // started at the solution: no exchange
        EXPECT_EQ(again.count.newton, rows) << n << (dense ? " dense" : " tridiagonal");
        EXPECT_EQ(again.count.fallbacks, 0);
        EXPECT_LE(again.change, tolerance(n));
      }
}

TEST_P(BackendLcp, ShiftedRows) {
  for (const Index n : {1, 3, 17, 40})
    for (const double D : {-0.05, 0.5}) {
      Random random{std::uint32_t(50 + n)};
      const Tridiagonal M = random_tridiagonal(random, n);
      const Matrix shifted = to_dense(LcpMatrix(M)) + D * Matrix::Identity(n, n);
      const Index rows = 20;
      const RowMatrix q = random.matrix(rows, n);
      RowMatrix y = random.matrix(rows, n).cwiseMax(0);
      const RowMatrix before = y;
      const auto lcp = backend->shifted_lcp(LcpMatrix(M), LcpClass::P, D, rows);
      EXPECT_EQ(solve(*lcp, q, y).count.unsolved, 0);
      // Half of the smallest margin of dominance is left.
      for (Index j = 0; j < rows; ++j) {
        const Vector expected = solved_alone(shifted, (q.row(j) - D * before.row(j)).transpose(), LcpClass::P);
        EXPECT_LE((y.row(j).transpose() - expected).cwiseAbs().maxCoeff(), 2 * tolerance(n)) << n << ' ' << D;
      }
      const RowMatrix w = q + y * to_dense(LcpMatrix(M)).transpose();
      double natural = 0;
      for (Index j = 0; j < rows; ++j)
        natural = std::max(
            natural, y.row(j).cwiseMin(w.row(j)).cwiseAbs().maxCoeff() / std::max(1.0, q.row(j).cwiseAbs().maxCoeff()));
      EXPECT_NEAR(residual, natural, tolerance(n)) << "the residual knows no shift";
    }
}

// Two plans, alternately.
TEST_P(BackendLcp, SubmittedBatchesAreSummedUp) {
  const Index n = 17, rows = 50;
  Random random{61};
  for (const LcpMatrix& M : {LcpMatrix(random_tridiagonal(random, n)), LcpMatrix(random.dominant(n))}) {
    const auto lcp = backend->lcp(M, LcpClass::P, rows), other = backend->lcp(M, LcpClass::P, rows);
    const auto v = backend->array(rows, n), y = backend->array(rows, n), expected = backend->array(rows, n);
    const auto first = device(random.matrix(rows, n)), second = device(random.matrix(rows, n));
    lcp->solve(*first, *v, *expected, 0);
    lcp->submit(*first, *v, *y, 0, -1);
    lcp->submit(*second, *v, *y, 0, -1);
    other->submit(*second, *v, *y, 7, -1);
    const LcpReport both = lcp->collect();
    EXPECT_EQ(both.count.solved, 2 * rows);
    EXPECT_EQ(both.count.unsolved, 0);
    EXPECT_GE(both.count.newton, 2 * rows);
    EXPECT_GE(both.magnitude, (1 - tolerance(n)) * host(*y).cwiseAbs().maxCoeff());
    EXPECT_EQ(other->collect().count.solved, rows - 7);
    const LcpReport one = lcp->solve(*second, *v, *expected, 0);
    EXPECT_LE(distance(host(*y), host(*expected)), tolerance(n));
    EXPECT_EQ(one.count.solved, rows) << "a batch that is finished reports itself alone";
    EXPECT_EQ(lcp->collect().count.solved, 0) << "nothing was submitted since";
    lcp->submit(*first, *v, *y, 3, -1);
    EXPECT_EQ(lcp->collect().count.solved, rows - 3);
  }
}

// A batch in modes against the separate operations, from the same y; unsolved rows keep their y.
TEST_P(BackendLcp, BatchesBetweenSineTransforms) {
  struct Case {
    Tridiagonal M;
    LcpClass lcp_class;
    double D;
  };
  const auto uniform = [](Index n, double beside, double diagonal) {
    return Tridiagonal{Vector::Constant(n, beside), Vector::Constant(n, diagonal), Vector::Constant(n, beside)};
  };
  for (const Index n : {63, 127, 255, 511, 1023})
    for (const Index rows : {1, 2, 67}) {
      // In the last case only problems with q >= 0 have a solution, y = 0: one row in three.
      for (const Case& c : {Case{uniform(n, -1, 4), LcpClass::P, 0}, Case{uniform(n, -1, 4), LcpClass::P, -1.1},
                            Case{uniform(n, -2, 1), LcpClass::Z, 0}}) {
        const auto S = backend->sine_transform(n, rows);
        const auto lcp = backend->shifted_lcp(c.M, c.lcp_class, c.D, rows);
        const auto other = backend->shifted_lcp(c.M, c.lcp_class, c.D, rows);
        if (backend->name() == "cuda") {
          EXPECT_TRUE(lcp->submit_in_modes) << n << ' ' << rows;
        }
        if (!lcp->submit_in_modes) continue;
        Random random{std::uint32_t(n + rows)};
        RowMatrix q = random.matrix(rows, n);
        const bool few_solutions = c.lcp_class == LcpClass::Z;
        for (Index j = 0; few_solutions && j < rows; ++j)
          q.row(j) = (j % 3 == 0 ? 1 : -1) * (q.row(j).array().abs() + 1);
        RowMatrix broken = 0.1 * random.matrix(rows, n);
        if (rows > 2) broken(rows / 2, n / 3) = NAN;
        RowMatrix before = random.matrix(rows, n).cwiseMax(0);
        for (Index j = 0; few_solutions && j < rows; j += 3) before.row(j).setZero();
        const auto r = device(q), modes = device(broken);
        const auto v = backend->array(rows, n), y = backend->array(rows, n), expected = backend->array(rows, n),
                   y_modes = backend->array(rows, n), expected_modes = backend->array(rows, n);
        S->apply(*modes, nullptr, *v, 0);
        for (const bool v_in_modes : {false, true})
          for (const bool wanted : {false, true}) {
            const Index first = rows > 2 && wanted ? 1 : 0;
            for (Array* array : {y.get(), expected.get(), y_modes.get(), expected_modes.get()})
              backend->upload(before, *array);
            lcp->submit_in_modes(*S, *r, v_in_modes ? *modes : *v, v_in_modes, *y, wanted ? y_modes.get() : nullptr,
                                 first);
            other->submit(*r, *v, *expected, first, -1);
            if (wanted) S->apply(*expected, nullptr, *expected_modes, first);
            const LcpReport found = lcp->collect(), report = other->collect();
            EXPECT_EQ(found.count.solved, report.count.solved) << n << ' ' << rows;
            EXPECT_EQ(found.count.unsolved, report.count.unsolved) << n << ' ' << rows;
            EXPECT_EQ(found.count.newton, report.count.newton) << n << ' ' << rows;
            EXPECT_EQ(found.count.unsolved > 0, rows > 2 || (few_solutions && rows > 1)) << n << ' ' << rows;
            // ||(M + D)^{-1}|| < 1.2; transforms of n values of size 1 are exact to log2 n roundings of their norm.
            const double tolerance = 64 * epsilon * std::sqrt(double(n));
            EXPECT_NEAR(found.magnitude, report.magnitude, tolerance);
            EXPECT_LE(distance(host(*y), host(*expected)), tolerance) << n << ' ' << rows;
            // rows before the first are unchanged, as are all rows if modes are not requested
            EXPECT_LE(distance(host(*y_modes), host(*expected_modes)), tolerance) << n << ' ' << rows;
          }
      }
    }
}

TEST_P(BackendLcp, FirstAndSettledRows) {
  const Index n = 5, rows = 40;
  Random random(3);
  for (const LcpMatrix& M : {LcpMatrix(random_tridiagonal(random, n)), LcpMatrix(random.dominant(n))}) {
    RowMatrix q = random.matrix(rows, n), y = RowMatrix::Zero(rows, n);
    const auto lcp = backend->lcp(M, LcpClass::P, rows);
    solve(*lcp, q, y);
    const RowMatrix solution = y;
    q.bottomRows(rows - 25) = random.matrix(rows - 25, n).array() - 2;  // every row from 25 on has another solution
    LcpReport report = solve(*lcp, q, y, 0, 1e-10);
    EXPECT_EQ(report.settled, 25);
    EXPECT_EQ(solve(*lcp, q, y, 0, 1e-10).settled, rows);
    y = solution;
    report = solve(*lcp, q, y, 30, 1e-10);
    EXPECT_EQ(report.count.solved, 10);
    EXPECT_EQ(report.settled, 30) << "rows before first are final";
    EXPECT_EQ(y.topRows(30), solution.topRows(30));
    EXPECT_GT(distance(y.bottomRows(10), solution.bottomRows(10)), 0.1);
  }
}

TEST_P(BackendLcp, EndsWhereNewtonCycles) {
  const Matrix cycling{{1, 0, 2}, {2, 1, 0}, {0, 2, 1}};
  const Index rows = 8;  // one row per starting set
  RowMatrix y(rows, 3);
  for (Index j = 0; j < rows; ++j) y.row(j) << double(j & 1), double(j >> 1 & 1), double(j >> 2 & 1);
  const LcpReport report = solve(*backend->lcp(cycling, LcpClass::P, rows), RowMatrix::Constant(rows, 3, -1), y);
  EXPECT_EQ(report.count.solved, rows);
  EXPECT_GT(report.count.fallbacks, 0);
  EXPECT_LE(distance(y, RowMatrix::Constant(rows, 3, 1. / 3)), 1e-14);
}

TEST_P(BackendLcp, LeastElementsAndInfeasibleRows) {
  const Index rows = 19;
  const Matrix fold{{1, -2}, {-2, 1}};
  const Vector both = Vector::Ones(2);
  // n = 2 in lanes and as a tridiagonal matrix; n = 34 as 17 uncoupled folds, row by row.
  Matrix many = Matrix::Zero(34, 34);
  for (Index i = 0; i < 17; ++i) many.block(2 * i, 2 * i, 2, 2) = fold;
  for (const LcpMatrix& M : {LcpMatrix(fold), LcpMatrix(Tridiagonal{-2 * both, both, -2 * both}), LcpMatrix(many)}) {
    const Index copies = size(M) / 2;
    RowMatrix q = Eigen::RowVector2d(-1, 3).replicate(rows, copies);
    RowMatrix y = Eigen::RowVector2d(5. / 3, 1. / 3).replicate(rows, copies);  // a solution, but not the least one
    const RowMatrix least = Eigen::RowVector2d(1, 0).replicate(rows, copies);
    const auto lcp = backend->lcp(M, LcpClass::Z, rows);
    LcpReport report = solve(*lcp, q, y);
    EXPECT_EQ(report.count.solved, rows) << size(M);
    EXPECT_LE(distance(y, least), 1e-14) << size(M);
    q(13, 1) = q(17, 1) = 1.9;  // y_1 >= 1 + 2 y_2, y_2 >= 2 y_1 - 1.9: infeasible
    report = solve(*lcp, q, y);
    EXPECT_EQ(report.infeasible, 13) << size(M);
    EXPECT_EQ(report.count.unsolved, 2) << size(M);
    EXPECT_EQ(report.count.solved, rows - 2) << size(M);
    EXPECT_TRUE(report.finite);
    EXPECT_LE(distance(y.topRows(13), least.topRows(13)), 1e-14) << size(M);
  }
}

TEST_P(BackendLcp, LeastNormRows) {
  // Pairs of equal diodes, M = R [[1, 1], [1, 1]], in lanes, tridiagonal and row by row: y_0 + y_1 is determined.
  const double R = 1e3;
  const Index rows = 19;
  const Matrix pair = R * Matrix::Ones(2, 2);
  const Vector both = R * Vector::Ones(2);
  Matrix many = Matrix::Zero(34, 34);
  for (Index i = 0; i < 17; ++i) many.block(2 * i, 2 * i, 2, 2) = pair;
  for (const LcpMatrix& M : {LcpMatrix(pair), LcpMatrix(Tridiagonal{both, both, both}), LcpMatrix(many)}) {
    const Index copies = size(M) / 2;
    RowMatrix q = -RowMatrix::Ones(rows, size(M));
    RowMatrix y = Eigen::RowVector2d(1 / R, 0).replicate(rows, copies);  // a solution, but not of least norm
    RowMatrix least = RowMatrix::Constant(rows, size(M), 0.5 / R);
    q.row(5).setOnes();
    least.row(5).setZero();
    const auto lcp = backend->lcp(M, LcpClass::PSD, rows);
    const LcpReport report = solve(*lcp, q, y);
    EXPECT_EQ(report.count.solved, rows) << size(M);
    EXPECT_LE(distance(y, least), 1e-14 / R * double(size(M))) << size(M);
    EXPECT_EQ(report.infeasible, -1) << size(M);
  }
  // Relays, M = [[0, 1], [-1, 0]]: q_1 < 0 requires y_0 <= q_1.
  RowMatrix q = Eigen::RowVector2d(-2, 1).replicate(rows, 1), y = RowMatrix::Zero(rows, 2);
  q(7, 1) = -1;
  const LcpReport report = solve(*backend->lcp(Matrix{{0, 1}, {-1, 0}}, LcpClass::PSD, rows), q, y);
  EXPECT_EQ(report.infeasible, 7);
  EXPECT_EQ(report.count.solved, rows - 1);
  EXPECT_LE((y.row(0) - Eigen::RowVector2d(1, 2)).cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_EQ(solve(*backend->lcp(Matrix{{0, 1}, {-1, 0}}, LcpClass::PSD, rows), q, y, 0, 1).settled, 7)
      << "what has no solution has not settled, though it stands still";
}

// Symmetric M of rank n - 1. A solution y is that of least norm if y (z - y) >= 0 for all others, of which one is
// known.
TEST_P(BackendLcp, LeastNormRowsOfManyUnknowns) {
  const Index rows = 21;
  for (const Index n : {2, 7, 16, 24, 64, 90}) {
    Random random{std::uint32_t(n)};
    const Matrix G = random.matrix(n, n - 1), M = G * G.transpose() / double(n);
    const RowMatrix signs = random.matrix(rows, n), known = signs.cwiseMax(0);
    const RowMatrix q = RowMatrix((-signs).cwiseMax(0)) - known * M;
    RowMatrix y = RowMatrix::Zero(rows, n);
    const LcpReport report = solve(*backend->lcp(LcpMatrix(M), LcpClass::PSD, rows), q, y);
    EXPECT_EQ(report.count.solved, rows) << n;
    EXPECT_LE(residual, 1e-12) << n;
    // Known to 1e-11 along the null space, where the shift of the least norm is 1e-3 to 1e-5 of M.
    for (Index j = 0; j < rows; ++j)
      EXPECT_GE(y.row(j).dot(known.row(j) - y.row(j)), -1e-10 * known.row(j).squaredNorm()) << n << ' ' << j;
  }
}

TEST_P(BackendLcp, NotFiniteRows) {
  for (const Index n : {1, 3, 17, 20}) {
    Random random(6);
    for (const LcpMatrix& M : {LcpMatrix(random_tridiagonal(random, n)), LcpMatrix(random.dominant(n))})
      for (const double bad : {double(NAN), double(INFINITY)}) {
        const Index rows = 11;
        RowMatrix q = random.matrix(rows, n);
        q(4, n / 2) = bad;
        RowMatrix y = RowMatrix::Zero(rows, n);
        const LcpReport report = solve(*backend->lcp(M, LcpClass::P, rows), q, y);
        EXPECT_FALSE(report.finite) << n;
        EXPECT_EQ(report.count.unsolved, 1) << n;
        EXPECT_LE(report.settled, 4) << n;
        for (Index j = 0; j < rows; ++j) {
          if (j == 4) continue;
          EXPECT_LE((y.row(j).transpose() - solved_alone(to_dense(M), q.row(j), LcpClass::P)).cwiseAbs().maxCoeff(),
                    tolerance(n))
              << n << ", row " << j;
        }
      }
  }
}

TEST_P(BackendLcp, NaturalResidual) {
  for (const Index n : {1, 2, 17}) {
    Random random(7);
    for (const LcpMatrix& M : {LcpMatrix(random_tridiagonal(random, n)), LcpMatrix(random.dominant(n))}) {
      const RowMatrix R = 3 * random.matrix(9, n), V = random.matrix(9, n), Y = random.matrix(9, n);
      double worst = 0;
      for (Index j = 0; j < 9; ++j) {
        const Vector q = R.row(j) + V.row(j), y = Y.row(j), w = to_dense(M) * y + q;
        worst = std::max(worst, y.cwiseMin(w).cwiseAbs().maxCoeff() / std::max(1.0, q.cwiseAbs().maxCoeff()));
      }
      const auto lcp = backend->lcp(M, LcpClass::P, 9);
      EXPECT_NEAR(lcp->residual(*device(R), *device(V), *device(Y)), worst, 16 * epsilon * double(n) * (1 + worst))
          << n;
      // A NaN anywhere is reported.
      for (const Index j : {0, 4, 8}) {
        RowMatrix broken = Y;
        broken(j, 0) = NAN;
        EXPECT_TRUE(std::isnan(lcp->residual(*device(R), *device(V), *device(broken)))) << n << ", row " << j;
      }
    }
  }
}

}  // namespace
}  // namespace bromwich

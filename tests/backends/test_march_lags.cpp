// Contract of marches on lag weights: against a loop over the weights, and against the recurrence behind them.

#include "core/lcp/active_set.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/oracle.hpp"

#include <Eigen/Dense>

#include <cmath>

namespace bromwich {
namespace {

using reference::Random;

class BackendMarchLags : public BackendTest {
 protected:
  struct Outcome {
    MarchReport report;
    RowMatrix y, v;
  };
  Outcome march(const Matrix& M, LcpClass c, const LagTable* lags, const Recurrence* recurrence, const RowMatrix& r,
                const Vector& y0, const std::function<void(MarchProblem&)>& change = {}) {
    const LcpMatrix matrix = M;
    const auto r_array = device(r);
    MarchProblem problem;
    problem.M = &matrix;
    problem.lcp_class = c;
    problem.lags = lags;
    problem.recurrence = recurrence;
    problem.r = r_array.get();
    if (change) change(problem);
    RowMatrix start = RowMatrix::Zero(r.rows(), r.cols());
    start.row(0) = y0.transpose();
    const auto y = device(start), v = backend->array(r.rows(), r.cols());
    const auto plan = backend->march(problem, r.rows());
    EXPECT_GT(plan->bytes(), 0u);
    Outcome out;
    out.report = plan->run(*y, *v);
    out.y = host(*y);
    out.v = host(*v);
    return out;
  }
};

INSTANTIATE_TEST_SUITE_P(Contract, BackendMarchLags, testing::ValuesIn(backend_cases()), backend_case_name);

LagTable decaying_table(Random& random, Index J, Index n, double rate) {
  LagTable table{n, n, false, RowMatrix(J + 1, n * n), RowMatrix(J + 1, n * n)};
  for (Index d = 0; d <= J; ++d) {
    table.W.row(d) = 0.1 * std::exp(-rate * double(d)) * random.matrix(1, n * n);
    table.S.row(d) = 0.1 * std::exp(-rate * double(d)) * random.matrix(1, n * n);
  }
  table.S.row(0).setZero();
  return table;
}

/// y_j in SOL(M + W_0, r_j + Σ_{1<=d<j} W_d y_{j-d} + S_j y_0), term by term.
void loop(const Matrix& M, const LagTable& table, const RowMatrix& r, RowMatrix& y, RowMatrix& v) {
  const Index n = r.cols();
  const auto at = [n](const RowMatrix& rows, Index d) { return Eigen::Map<const RowMatrix>(rows.row(d).data(), n, n); };
  v = RowMatrix::Zero(r.rows(), n);
  for (Index j = 1; j < r.rows(); ++j) {
    Vector known = at(table.S, j) * y.row(0).transpose();
    for (Index d = 1; d < j; ++d) known += at(table.W, d) * y.row(j - d).transpose();
    const auto found = oracle::solve_lcp(M + at(table.W, 0), r.row(j).transpose() + known, LcpClass::P);
    ASSERT_TRUE(found);
    y.row(j) = found->transpose();
    v.row(j) = (known + at(table.W, 0) * *found).transpose();
  }
}

TEST_P(BackendMarchLags, AgreesWithALoop) {
  // Below, at, and above one block of 64 rows; several levels; sizes that end inside a target interval.
  for (const Index n : {1, 3})
    for (const Index J : {1, 2, 7, 63, 64, 65, 100, 128, 129, 320, 1000}) {
      Random random{std::uint32_t(1000 * n + J)};
      // Σ |W_d| <= 0.1 n / (1 - e^{-0.5}) < 0.8, ||(M + W_0)^{-1}|| <= 1: rounding grows by 1/(1 - 0.8) = 5 from some
      // n eps per block and eps of the FFT.
      const LagTable table = decaying_table(random, J, n, 0.5);
      const Matrix M = random.dominant(n) + 1.5 * Matrix::Identity(n, n);
      const RowMatrix r = random.matrix(J + 1, n);
      const Vector y0 = random.vector(n).cwiseAbs();
      RowMatrix y = RowMatrix::Zero(J + 1, n), v;
      y.row(0) = y0.transpose();
      loop(M, table, r, y, v);
      const Outcome found = march(M, LcpClass::P, &table, nullptr, r, y0);
      EXPECT_LE(distance(found.y, y), 1e-13) << n << ' ' << J;
      EXPECT_LE(distance(found.v, v), 1e-13) << n << ' ' << J;
      EXPECT_EQ(found.report.count.solved, J);
      EXPECT_EQ(found.report.count.unsolved, 0);
      EXPECT_EQ(found.report.stopped, -1);
      EXPECT_EQ(found.report.infeasible, -1);
      EXPECT_TRUE(found.report.finite);
    }
}

TEST_P(BackendMarchLags, AgreesWithTheRecurrence) {
  // Slow decay, so that all blocks matter, and growth by e^{12} over the horizon. Both solve the same discrete problem.
  const Index J = 777;
  for (const double sigma : {-0.5, 12.0})
    for (const Index n : {1, 3}) {
      Random random{std::uint32_t(n)};
      const Index m = 4;
      const Matrix A = 0.3 * random.matrix(m, m) + sigma * Matrix::Identity(m, m);
      const DenseDynamics d{A, random.matrix(m, n) * (sigma > 0 ? 1e-5 : 0.1), random.matrix(n, m)};
      const Recurrence recurrence = dense_recurrence(d, Rule::exponential, 1.0 / double(J));
      const LagTable table = lag_table(recurrence, J);
      const Matrix M = random.dominant(n) + Matrix::Identity(n, n);
      const RowMatrix r = random.matrix(J + 1, n);
      const Vector y0 = random.vector(n).cwiseAbs();
      const Outcome expected = march(M, LcpClass::P, nullptr, &recurrence, r, y0),
                    found = march(M, LcpClass::P, &table, nullptr, r, y0);
      // The kernel's L1 norm is below 4 (e^{12} 1e-5/12 = 0.1 or 0.1 a product of N and B): amplified by at most e^4.
      EXPECT_LE(distance(found.y, expected.y), 1e-11) << sigma << ' ' << n;
      EXPECT_LE(distance(found.v.bottomRows(J), expected.v.bottomRows(J)), 1e-11) << sigma << ' ' << n;
      EXPECT_GT(expected.v.cwiseAbs().maxCoeff(), 1e-6);
    }
}

TEST_P(BackendMarchLags, StopsWhereNothingSolves) {
  const Index rows = 140, bad = 100;
  LagTable table{2, 2, false, RowMatrix::Constant(rows, 4, 1e-9), RowMatrix::Zero(rows, 4)};
  const Matrix fold{{1, -2}, {-2, 1}};
  RowMatrix r = Eigen::RowVector2d(-1, 3).replicate(rows, 1);
  r(bad, 1) = 1.9;
  const Outcome infeasible = march(fold, LcpClass::Z, &table, nullptr, r, Vector{{1, 0}});
  EXPECT_EQ(infeasible.report.infeasible, bad);
  EXPECT_EQ(infeasible.report.count.solved, bad - 1);
  // 1e-9 from at most 100 rows.
  EXPECT_LE(distance(infeasible.y.topRows(bad), Eigen::RowVector2d(1, 0).replicate(bad, 1)), 1e-6);
  EXPECT_TRUE(infeasible.y.bottomRows(rows - bad).array().isNaN().all());
  EXPECT_TRUE(infeasible.v.bottomRows(rows - bad).array().isNaN().all());
  EXPECT_TRUE(infeasible.report.finite);

  r(bad, 1) = 3;
  r(70, 0) = std::numeric_limits<double>::quiet_NaN();
  const Outcome broken = march(fold, LcpClass::Z, &table, nullptr, r, Vector{{1, 0}});
  EXPECT_FALSE(broken.report.finite);
  EXPECT_EQ(broken.report.stopped, 70);
  EXPECT_EQ(broken.report.infeasible, -1);
  EXPECT_TRUE(broken.y.topRows(70).allFinite());
  EXPECT_TRUE(broken.y.bottomRows(rows - 70).array().isNaN().all());
}

TEST_P(BackendMarchLags, ReportsProgressAndCanBeInterrupted) {
  const Index rows = 400;
  Random random(1);
  const LagTable table = decaying_table(random, rows - 1, 1, 0.5);
  const RowMatrix r = random.matrix(rows, 1);
  std::vector<Index> steps;
  const Outcome outcome =
      march(Matrix::Constant(1, 1, 2), LcpClass::P, &table, nullptr, r, Vector::Zero(1), [&](MarchProblem& problem) {
        problem.progress = [&](Index step) { steps.push_back(step); };
        problem.interrupted = [&] { return !steps.empty() && steps.back() >= 200; };
      });
  EXPECT_TRUE(outcome.report.interrupted);
  ASSERT_FALSE(steps.empty());
  EXPECT_EQ(outcome.report.stopped, steps.back());
  EXPECT_TRUE(outcome.y.topRows(steps.back()).allFinite());
  EXPECT_TRUE(outcome.y.bottomRows(rows - steps.back()).array().isNaN().all());
}

}  // namespace
}  // namespace bromwich

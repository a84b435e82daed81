// The contract of the Backend seam: step-by-step solutions against a loop over the lag table.

#include "core/lcp/active_set_lcp.hpp"
#include "tests/backends.hpp"
#include "tests/oracle.hpp"

#include <Eigen/Dense>

namespace bromwich {
namespace {

using reference::Random;

class BackendMarch : public BackendTest {
 protected:
  struct Outcome {
    MarchReport report;
    RowMatrix y, v;
  };
  Outcome march(const LcpMatrix& M, LcpClass c, const Recurrence& recurrence, const RowMatrix& r,
                const RowMatrix* drive, const Vector& y0) {
    const auto r_array = device(r), drive_array = drive ? device(*drive) : nullptr;
    std::unique_ptr<Array> added, forcing;
    Vector z0;
    MarchProblem problem;
    problem.M = &M;
    problem.lcp_class = c;
    problem.recurrence = &recurrence;
    problem.r = r_array.get();
    problem.drive = drive_array.get();
    if (const auto* dense = std::get_if<DenseRecurrence>(&recurrence); dense && drive) {
      // A state that is stepped takes its drive as a forcing of the state.
      added = device(r + *drive * dense->w0.transpose());
      forcing = device(*drive * dense->input.transpose());
      z0 = dense->start * drive->row(0).transpose();
      problem.r = added.get();
      problem.drive = nullptr;
      problem.forcing = forcing.get();
      problem.start = &z0;
    }
    RowMatrix start = RowMatrix::Zero(r.rows(), r.cols());
    start.row(0) = y0.transpose();
    const auto y = device(start), v = backend->array(r.rows(), r.cols());
    const auto plan = backend->march(problem, r.rows());
    Outcome out;
    out.report = plan->run(*y, *v);
    out.y = host(*y);
    out.v = host(*v);
    if (added) out.v += host(*added) - r;  // v + r is what counts
    return out;
  }
};

INSTANTIATE_TEST_SUITE_P(Contract, BackendMarch, testing::ValuesIn(backend_cases()), backend_case_name);

/// Dense n x n weights of every lag.
std::vector<Matrix> dense_weights(const LagTable& table, const RowMatrix& rows) {
  std::vector<Matrix> all;
  const Matrix S = reference::sine_matrix(table.outputs);
  for (Index d = 0; d < rows.rows(); ++d) {
    if (table.modal)
      all.push_back(S * rows.row(d).asDiagonal() * S);
    else
      all.push_back(Eigen::Map<const RowMatrix>(rows.row(d).data(), table.outputs, table.inputs));
  }
  return all;
}

struct Trajectory {
  RowMatrix y, v;
};

/// y_j in SOL(M + W_0, r_j + Σ_{1<=d<j} W_d u_{j-d} + S_j u_0 + W_0 phi_j), u = y + phi.
Trajectory loop(const Matrix& M, const LagTable& table, const RowMatrix& r, const RowMatrix* drive, const Vector& y0) {
  const Index rows = r.rows(), n = r.cols();
  const std::vector<Matrix> W = dense_weights(table, table.W), S = dense_weights(table, table.S);
  const RowMatrix phi = drive ? *drive : RowMatrix::Zero(rows, n);
  Trajectory out{RowMatrix::Zero(rows, n), RowMatrix::Zero(rows, n)};
  out.y.row(0) = y0.transpose();
  for (Index j = 1; j < rows; ++j) {
    Vector known = W[0] * phi.row(j).transpose() + S[std::size_t(j)] * (out.y.row(0) + phi.row(0)).transpose();
    for (Index d = 1; d < j; ++d) known += W[std::size_t(d)] * (out.y.row(j - d) + phi.row(j - d)).transpose();
    const Vector q = r.row(j).transpose() + known;
    Vector y;
    if (n <= 5) {
      const auto found = oracle::solve_lcp(M + W[0], q, LcpClass::P);
      EXPECT_TRUE(found);
      y = *found;
    } else {
      EXPECT_TRUE(ActiveSetLcp(M + W[0], LcpClass::P).solve(q, y).solved);
    }
    out.y.row(j) = y.transpose();
    out.v.row(j) = (known + W[0] * y).transpose();
  }
  return out;
}

/// Weights below 0.1 over 50 rows and ||(M + W_0)^{-1}|| <= 1: rounding grows at most by e^{Σ |W|}, below e^4, from n
/// eps a row.
constexpr double same = 1e-12;

TEST_P(BackendMarch, ModalAgainstALoop) {
  const Index rows = 50;
  for (const Index n : {1, 3, 8, 9, 39})
    for (const bool driven : {false, true}) {
      const KroneckerDynamics d = reference::signorini_dynamics(n, 5, 2e-3);
      Random random{std::uint32_t(n)};
      ModalRecurrence recurrence = modal_recurrence(d, n % 2 ? Rule::exponential : Rule::implicit_euler, 0.05, {});
      recurrence.w1 = 0.01 * random.vector(n);  // as compression leaves them
      recurrence.s1 = 0.01 * random.vector(n);
      const LcpMatrix M = Tridiagonal{-Vector::Ones(n), Vector::Constant(n, 4), -Vector::Ones(n)};
      const RowMatrix r = random.matrix(rows, n), drive = random.matrix(rows, n);
      const Vector y0 = random.vector(n).cwiseAbs();
      const Outcome found = march(M, LcpClass::P, recurrence, r, driven ? &drive : nullptr, y0);
      const Trajectory exact = loop(to_dense(M), lag_table(recurrence, rows - 1), r, driven ? &drive : nullptr, y0);
      EXPECT_LE(distance(found.y, exact.y), same) << n << (driven ? " driven" : "");
      EXPECT_LE(distance(found.v.bottomRows(rows - 1), exact.v.bottomRows(rows - 1)), same)
          << n << (driven ? " driven" : "");
      EXPECT_EQ(found.report.count.solved, rows - 1);
      EXPECT_EQ(found.report.count.unsolved, 0);
      EXPECT_EQ(found.report.stopped, -1);
      EXPECT_EQ(found.report.infeasible, -1);
      EXPECT_TRUE(found.report.finite);
    }
}

TEST_P(BackendMarch, ModalWithAnInitialState) {
  const Index rows = 30, n = 9;
  const KroneckerDynamics d = reference::signorini_dynamics(n, 5, 2e-3);
  Random random(4);
  ModalRecurrence recurrence = modal_recurrence(d, Rule::exponential, 0.05, random.matrix(n, 5));
  const LcpMatrix M = Tridiagonal{-Vector::Ones(n), Vector::Constant(n, 4), -Vector::Ones(n)};
  const RowMatrix r = random.matrix(rows, n);
  const Outcome found = march(M, LcpClass::P, recurrence, r, nullptr, Vector::Zero(n));
  // The same part of v, moved to r by hand: S Σ_k C_k E_k^{j-1} initial_k.
  RowMatrix moved = RowMatrix::Zero(rows, n), part = recurrence.output.cwiseProduct(recurrence.initial);
  for (Index j = 1; j < rows; ++j, part = part.cwiseProduct(recurrence.decay))
    moved.row(j) = part.colwise().sum() * reference::sine_matrix(n);
  recurrence.initial.resize(0, 0);
  const Trajectory exact = loop(to_dense(M), lag_table(recurrence, rows - 1), r + moved, nullptr, Vector::Zero(n));
  EXPECT_LE(distance(found.y, exact.y), same);
  EXPECT_LE(distance(found.v.bottomRows(rows - 1), (exact.v + moved).bottomRows(rows - 1)), same);
}

TEST_P(BackendMarch, DenseAgainstALoop) {
  const Index rows = 50;
  for (const auto& [n, m] : {std::pair<Index, Index>{1, 1}, {1, 4}, {3, 5}, {5, 2}, {17, 6}})
    for (const bool driven : {false, true}) {
      Random random{std::uint32_t(10 * n + m)};
      const DenseDynamics d{random.matrix(m, m) - Matrix(2 * Matrix::Identity(m, m)), random.matrix(m, n) / double(n),
                            random.matrix(n, m) / double(m)};
      const Recurrence recurrence = dense_recurrence(d, n % 2 ? Rule::exponential : Rule::implicit_euler, 0.02);
      const LcpMatrix M = Matrix(random.dominant(n) + Matrix::Identity(n, n));
      const RowMatrix r = random.matrix(rows, n), drive = random.matrix(rows, n);
      const Vector y0 = random.vector(n).cwiseAbs();
      const Outcome found = march(M, LcpClass::P, recurrence, r, driven ? &drive : nullptr, y0);
      const Trajectory exact = loop(to_dense(M), lag_table(recurrence, rows - 1), r, driven ? &drive : nullptr, y0);
      EXPECT_LE(distance(found.y, exact.y), same) << n << ' ' << m << (driven ? " driven" : "");
      EXPECT_LE(distance(found.v.bottomRows(rows - 1), exact.v.bottomRows(rows - 1)), same) << n << ' ' << m;
      EXPECT_EQ(found.report.count.solved, rows - 1);
    }
}

TEST_P(BackendMarch, StopsWhereNothingSolves) {
  const Index rows = 12;
  // Almost no dynamics: the rows are LCP(M, r_j) up to 1e-9.
  const DenseDynamics d{Matrix{{-1}}, Matrix::Constant(1, 2, 1e-9), Matrix::Ones(2, 1)};
  const Recurrence recurrence = dense_recurrence(d, Rule::exponential, 0.1);
  const LcpMatrix fold = Matrix{{1, -2}, {-2, 1}};
  RowMatrix r = Eigen::RowVector2d(-1, 3).replicate(rows, 1);
  r(7, 1) = 1.9;
  const Outcome infeasible = march(fold, LcpClass::Z, recurrence, r, nullptr, Vector{{1, 0}});
  EXPECT_EQ(infeasible.report.infeasible, 7);
  EXPECT_EQ(infeasible.report.count.solved, 6);
  EXPECT_LE(distance(infeasible.y.topRows(7), Eigen::RowVector2d(1, 0).replicate(7, 1)), 1e-7);  // 1e-9, a few steps
  EXPECT_TRUE(infeasible.y.bottomRows(rows - 7).array().isNaN().all());
  EXPECT_TRUE(infeasible.v.bottomRows(rows - 7).array().isNaN().all());
  EXPECT_TRUE(infeasible.report.finite);

  r(7, 1) = 3;
  r(4, 0) = std::numeric_limits<double>::quiet_NaN();
  const Outcome broken = march(fold, LcpClass::Z, recurrence, r, nullptr, Vector{{1, 0}});
  EXPECT_FALSE(broken.report.finite);
  EXPECT_EQ(broken.report.stopped, 4);
  EXPECT_EQ(broken.report.infeasible, -1);
  EXPECT_TRUE(broken.y.topRows(4).allFinite());
  EXPECT_TRUE(broken.y.bottomRows(rows - 4).array().isNaN().all());
}

}  // namespace
}  // namespace bromwich

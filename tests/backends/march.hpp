#pragma once
// Shared by the tests of marches: one march on a backend, and a loop over the lag table as its reference.

#include "core/lcp/active_set.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/oracle.hpp"

#include <Eigen/Dense>

namespace bromwich {

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
      // A dense recurrence takes its drive as a forcing of the state.
      added = device(r + *drive * dense->w0.transpose());
      forcing = device(*drive * dense->input.transpose());
      z0 = dense->start * drive->row(0).transpose();
      problem.r = added.get();
      problem.drive = nullptr;
      problem.forcing = forcing.get();
      problem.start = &z0;
      problem.sources = drive;
      problem.source_input = &dense->input;
    }
    RowMatrix start = RowMatrix::Zero(r.rows(), r.cols());
    start.row(0) = y0.transpose();
    const auto y = device(start), v = backend->array(r.rows(), r.cols());
    const auto plan = backend->march(problem, r.rows());
    Outcome out;
    out.report = plan->run(*y, *v);
    out.y = host(*y);
    out.v = host(*v);
    if (added) out.v += host(*added) - r;  // only v + r matters
    return out;
  }
};

/// Dense n x n weights, one per lag.
inline std::vector<Matrix> dense_weights(const LagTable& table, const RowMatrix& rows) {
  std::vector<Matrix> all;
  const Matrix V = table.face.is_sine() ? reference::sine_matrix(table.outputs) : table.face.matrix();
  for (Index d = 0; d < rows.rows(); ++d) {
    if (table.modal)
      all.push_back(V * rows.row(d).asDiagonal() * V.transpose());
    else
      all.push_back(Eigen::Map<const RowMatrix>(rows.row(d).data(), table.outputs, table.inputs));
  }
  return all;
}

struct Trajectory {
  RowMatrix y, v;
};

/// y_j in SOL(M + W_0, r_j + Σ_{1<=d<j} W_d u_{j-d} + S_j u_0 + W_0 phi_j), u = y + phi.
inline Trajectory loop(const Matrix& M, const LagTable& table, const RowMatrix& r, const RowMatrix* drive,
                       const Vector& y0) {
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

/// Weights below 0.1 over 50 rows and ||(M + W_0)^{-1}|| <= 1: rounding of n eps per row grows at most by e^{Σ |W|} <
/// e^4.
inline constexpr double same = 1e-12;

}  // namespace bromwich

#pragma once
// Shared by the batched complementarity solvers. Rows are processed `width` at a time, one row per SIMD lane. Each
// block runs semismooth Newton on min(y, w), an active-set iteration, until all its lanes settle. The few rows that do
// not settle go one by one to the pivoting solver of core/lcp/active_set.hpp.

#include "core/lcp/active_set.hpp"
#include "cpu/parts.hpp"
#include "cpu/simd.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <vector>

namespace bromwich::cpu {

/// Outcome of one block.
struct BlockOutcome {
  bool solved[2 * lanes] = {};  ///< per lane
  int sweeps[2 * lanes] = {};   ///< Newton sweeps per lane
};

/// Runs `newton(first row, rows, thread, outcome)` over blocks of rows and `pivot(row, thread)` on the unsolved rows.
/// Fills the report from the change of every row.
class RowBlocks {
 public:
  /// `row_work`: multiplications of a row, about.
  RowBlocks(Index rows, Index row_work, Team& team)
      : change_(std::size_t(rows)),
        magnitude_(std::size_t(rows)),
        left_(std::size_t(rows)),
        row_work_(row_work),
        team_(team) {}

  template <class Newton, class Pivot>
  LcpReport run(Index first, Index rows, Index width, double settle_tolerance, Newton newton, Pivot pivot) {
    LcpReport report;
    std::atomic<long> sweeps = 0;
    const Index count = (rows - first + width - 1) / width;
    team_.share(count, (rows - first) * row_work_ > parallel_size, [&](Index block, int thread) {
      const Index begin = first + block * width, size = std::min(width, rows - begin);
      BlockOutcome outcome;
      newton(begin, size, thread, outcome, change_.data() + begin, magnitude_.data() + begin);
      long of_block = 0;
      for (Index j = 0; j < size; ++j) {
        left_[std::size_t(begin + j)] = !outcome.solved[j];
        of_block += outcome.sweeps[j];
      }
      sweeps += of_block;
    });
    report.count.newton = sweeps;
    report.count.solved = rows - first;
    for (Index j = first; j < rows; ++j)
      if (left_[std::size_t(j)]) finish(report, j, pivot);
    for (Index j = first; j < rows; ++j) {
      double& change = change_[std::size_t(j)];
      const double magnitude = magnitude_[std::size_t(j)];
      change /= std::max(1.0, magnitude);
      report.finite = report.finite && std::isfinite(change);
      report.change = std::max(report.change, change);
      report.magnitude = std::max(report.magnitude, magnitude);
    }
    report.settled = first;
    const auto stays = [&](Index j) { return !left_[std::size_t(j)] && change_[std::size_t(j)] <= settle_tolerance; };
    while (report.settled < rows && stays(report.settled)) ++report.settled;
    return report;
  }

  std::size_t bytes() const { return change_.size() * (2 * sizeof(double) + 1); }

 private:
  static constexpr Index parallel_size = 1 << 11;  ///< multiplications, each of several sweeps: ten microseconds

  template <class Pivot>
  void finish(LcpReport& report, Index j, Pivot pivot) {
    ++report.count.fallbacks;
    const LcpOutcome outcome = pivot(j, change_[std::size_t(j)], magnitude_[std::size_t(j)]);
    report.count.newton += outcome.newton;
    left_[std::size_t(j)] = !outcome.solved;
    if (outcome.solved) return;
    --report.count.solved;
    ++report.count.unsolved;
    if (outcome.infeasible && report.infeasible < 0) report.infeasible = j;
  }

  std::vector<double> change_, magnitude_;
  std::vector<char> left_;
  Index row_work_;
  Team& team_;
};

/// Solves one row by pivoting and records how much it changed.
inline LcpOutcome pivot_row(ActiveSetLcp& solver, const Vector& q, double* y, Vector& fresh, double& change,
                            double& magnitude) {
  if (!q.allFinite()) {
    change = NAN;
    return {};
  }
  solver.reset();
  const LcpOutcome outcome = solver.solve(q, fresh);
  const Eigen::Map<Vector> old(y, q.size());
  change = (fresh - old).cwiseAbs().maxCoeff();
  magnitude = fresh.cwiseAbs().maxCoeff();
  Eigen::Map<Vector>(y, q.size()) = fresh;
  return outcome;
}

/// max_j ||min(y_j, w_j)||_inf / max(1, ||q_j||_inf) with w = M y + q; `product(y_j, w)` writes M y_j. NaN if any value
/// is not finite.
template <class Product>
double natural_residual(const RowMatrix& R, const RowMatrix& V, const RowMatrix& Y, Team& team, Product product) {
  const Index n = Y.cols();
  std::atomic<double> worst = 0;
  team.ranges(Y.rows(), Y.size() > worth_sharing, [&](Index begin, Index end) {
    Eigen::ArrayXd q(n), w(n);
    double mine = 0;
    for (Index j = begin; j < end; ++j) {
      const auto y = Y.row(j).transpose().array();
      q = R.row(j).transpose().array() + V.row(j).transpose().array();
      product(Y.row(j).data(), w.data());
      w += q;
      const double sum = w.abs().sum() + y.abs().sum();  // keeps a NaN; a maximum may drop it
      if (n == 0) continue;
      const double gap = y.min(w).abs().maxCoeff(), scale = std::max(1.0, q.abs().maxCoeff());
      mine = std::max(mine, std::isfinite(sum) ? gap / scale : INFINITY);
    }
    Team::raise(worst, mine);
  });
  return std::isinf(worst) ? NAN : worst.load();
}

/// The same for a dense M.
inline double natural_residual(const Matrix& M, const RowMatrix& R, const RowMatrix& V, const RowMatrix& Y,
                               Team& team) {
  return natural_residual(R, V, Y, team, [&M](const double* y, double* w) {
    Eigen::Map<Vector>(w, M.rows()).noalias() = M * Eigen::Map<const Vector>(y, M.cols());
  });
}

}  // namespace bromwich::cpu

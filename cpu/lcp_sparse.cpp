// Batches with a sparse M: eight rows (time points) at a time, one per lane, each by projected SOR in the order of the
// constraints (core/lcp/sparse_lcp.hpp). The lanes share every entry of M, so that a sweep reads M once for eight
// problems; there is nothing to colour. Sweeps end where y no longer moves beyond rounding, which the residual then
// confirms; rows that do not get there are solved by active sets.

#include "core/lcp/sparse_lcp.hpp"
#include "cpu/lcp_batch.hpp"

#include <string>

namespace bromwich::cpu {

namespace {

constexpr int most_sweeps = 2000;
constexpr double settled = 4 * epsilon;  ///< movement of y in a sweep, relative to its largest value

// M by rows without its diagonal, and omega / m_ii.
struct SparseRows {
  std::vector<Index> start, column;
  std::vector<double> value;
  Vector step, diagonal;

  SparseRows(const SparseMatrix& M, double omega) : step(omega / M.diagonal().array()), diagonal(M.diagonal()) {
    const Eigen::SparseMatrix<double, Eigen::RowMajor> by_rows = M;
    for (Index i = 0; i < by_rows.rows(); ++i) {
      start.push_back(Index(column.size()));
      for (Eigen::SparseMatrix<double, Eigen::RowMajor>::InnerIterator a(by_rows, i); a; ++a) {
        if (a.col() == i) continue;
        column.push_back(a.col());
        value.push_back(a.value());
      }
    }
    start.push_back(Index(column.size()));
  }
  Index count() const { return step.size(); }
};

class SparseLcp final : public ImmediateLcpBatch {
 public:
  /// `count`: sweeps of a batch; 0: until its problems are solved.
  SparseLcp(const SparseMatrix& M, double shift, const SweepPlan& plan, int count, Index rows, Team& team)
      : M_(M),
        shifted_(shifted(M, shift)),
        shift_(shift),
        count_(count),
        rows_(shifted_, plan.omega),
        row_blocks_(rows, M.nonZeros(), team),
        team_(team),
        plan_(plan),
        pivoting_(shifted_) {
    lanes_.resize(std::size_t(team.threads()));
    for (auto& block : lanes_) block.resize(std::size_t(2 * M.rows()));
  }

  LcpReport solve_now(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    const RowMatrix &R = host(r), &V = host(v);
    RowMatrix& Y = host(y);
    if (!plan_.converges) return without_sweeps(R, V, Y, first);
    return row_blocks_.run(
        first, R.rows(), lanes, settle_tolerance,
        [&](Index begin, Index size, int thread, BlockOutcome& outcome, double* change, double* magnitude) {
          sweep_block(R, V, Y, begin, size, lanes_[std::size_t(thread)], outcome, change, magnitude);
        },
        [&](Index j, double& change, double& magnitude) { return by_active_sets(R, V, Y, j, change, magnitude); });
  }

  double residual(const Array& r, const Array& v, const Array& y) override {
    return natural_residual(host(r), host(v), host(y), team_, [this](const double* values, double* w) {
      Eigen::Map<Vector>(w, M_.rows()) = M_ * Eigen::Map<const Vector>(values, M_.cols());
    });
  }

  std::size_t bytes() const override {
    return row_blocks_.bytes() + lanes_.size() * 2 * std::size_t(rows_.count()) * sizeof(Lanes) +
           28 * std::size_t(M_.nonZeros());
  }

 private:
  // One problem, such as that of t = 0 before a march, is left to active sets, whose solution is confirmed.
  LcpReport without_sweeps(const RowMatrix& R, const RowMatrix& V, RowMatrix& Y, Index first) {
    if (R.rows() - first > 1)
      throw Error("M", "is sparse with " + std::to_string(M_.rows()) + " rows, and " + plan_.why,
                  "projected sweeps do not solve it: use method march or euler, or give M as a dense matrix");
    LcpReport report;
    for (Index j = first; j < R.rows(); ++j) {
      double change = 0, magnitude = 0;
      const LcpOutcome outcome = by_active_sets(R, V, Y, j, change, magnitude);
      report.finite = std::isfinite(change);
      report.change = std::max(report.change, change);
      report.magnitude = std::max(report.magnitude, magnitude);
      ++(outcome.solved ? report.count.solved : report.count.unsolved);
    }
    return report;
  }

  static SparseMatrix shifted(SparseMatrix M, double shift) {
    for (Index i = 0; shift != 0 && i < M.rows(); ++i) M.coeffRef(i, i) += shift;
    return M;
  }

  void sweep_block(const RowMatrix& R, const RowMatrix& V, RowMatrix& Y, Index begin, Index size,
                   std::vector<Lanes>& work, BlockOutcome& outcome, double* change, double* magnitude) const {
    const Index n = rows_.count();
    Lanes *y = work.data(), *q = work.data() + n;
    for (Index i = 0; i < n; ++i)
      for (Index l = 0; l < lanes; ++l) {
        const Index j = begin + std::min(l, size - 1);
        y[i][l] = std::isfinite(Y(j, i)) ? std::max(Y(j, i), 0.0) : 0;
        q[i][l] = R(j, i) + V(j, i) - (shift_ != 0 ? shift_ * Y(j, i) : 0);
      }
    if (count_ > 0) return sweep_some(Y, begin, size, y, q, outcome, change, magnitude);
    Lanes largest = all(0), moved = all(0);
    int sweeps = 0;
    do {
      largest = all(0);
      moved = all(0);
      sweep(y, q, largest, moved);
    } while (++sweeps < most_sweeps && any(moved > all(settled) * largest));
    for (Index l = 0; l < size; ++l) {
      const Index j = begin + l;
      Vector found(n), given(n);
      for (Index i = 0; i < n; ++i) found[i] = y[i][l], given[i] = q[i][l];
      const bool finite = given.allFinite() && found.allFinite();
      outcome.sweeps[l] = sweeps;
      outcome.solved[l] = finite && relative_natural_residual(shifted_, given, found) <= accepted;
      change[l] = finite ? (n > 0 ? (found.transpose() - Y.row(j)).cwiseAbs().maxCoeff() : 0) : NAN;
      magnitude[l] = n > 0 ? found.cwiseAbs().maxCoeff() : 0;
      if (outcome.solved[l]) Y.row(j) = found.transpose();
    }
  }

  void sweep_some(RowMatrix& Y, Index begin, Index size, Lanes* y, const Lanes* q, BlockOutcome& outcome,
                  double* change, double* magnitude) const {
    Lanes largest = all(0), moved = all(0);
    for (int sweeps = 0; sweeps < count_; ++sweeps) sweep(y, q, largest, moved);
    for (Index l = 0; l < size; ++l) {
      double sum = 0, most = 0, farthest = 0;
      for (Index i = 0; i < rows_.count(); ++i) {
        sum += q[i][l] + y[i][l];
        most = std::max(most, y[i][l]);
        farthest = std::max(farthest, std::abs(y[i][l] - Y(begin + l, i)));
        Y(begin + l, i) = y[i][l];
      }
      outcome.sweeps[l] = count_;
      outcome.solved[l] = true;
      change[l] = std::isfinite(sum) ? farthest : NAN;
      magnitude[l] = most;
    }
  }

  void sweep(Lanes* y, const Lanes* q, Lanes& largest, Lanes& moved) const {
    for (Index i = 0; i < rows_.count(); ++i) {
      Lanes w = q[i] + all(rows_.diagonal[i]) * y[i];
      for (Index a = rows_.start[std::size_t(i)]; a < rows_.start[std::size_t(i) + 1]; ++a)
        w += all(rows_.value[std::size_t(a)]) * y[rows_.column[std::size_t(a)]];
      const Lanes next = max(all(0), y[i] - all(rows_.step[i]) * w);
      moved = max(moved, abs(next - y[i]));
      largest = max(largest, next);
      y[i] = next;
    }
  }

  LcpOutcome by_active_sets(const RowMatrix& R, const RowMatrix& V, RowMatrix& Y, Index j, double& change,
                            double& magnitude) {
    const Vector q = (R.row(j) + V.row(j) - shift_ * Y.row(j)).transpose();
    if (!q.allFinite()) {
      change = NAN;
      return {};
    }
    Vector fresh = Y.row(j).transpose();
    const LcpOutcome outcome = pivoting_.solve(q, fresh);
    change = (fresh.transpose() - Y.row(j)).cwiseAbs().maxCoeff();
    magnitude = fresh.cwiseAbs().maxCoeff();
    Y.row(j) = fresh.transpose();
    return outcome;
  }

  /// Natural residual relative to the terms of w: rounding of a sum of a row's entries, and of the last sweep.
  static constexpr double accepted = 1e-14;

  SparseMatrix M_, shifted_;
  double shift_;
  int count_;
  SparseRows rows_;
  RowBlocks row_blocks_;
  Team& team_;
  SweepPlan plan_;
  SparseActiveSet pivoting_;
  std::vector<std::vector<Lanes>> lanes_;
};

constexpr Index largest_written_out = 256;

}  // namespace

std::unique_ptr<LcpBatch> make_projected_sweeps(const ProjectedSweeps& sweeps, Index rows, Team& team) {
  const SweepPlan plan{true, sweeps.omega, 0, ""};
  return std::make_unique<SparseLcp>(*sweeps.M, sweeps.shift, plan, sweeps.count, rows, team);
}

std::unique_ptr<LcpBatch> make_sparse_lcp(const SparseMatrix& M, LcpClass lcp_class, double shift, Index rows,
                                          Team& team) {
  SparseMatrix with_shift = M;
  for (Index i = 0; shift != 0 && i < M.rows(); ++i) with_shift.coeffRef(i, i) += shift;
  const SweepPlan plan = plan_sweeps(with_shift);
  // Sweeps converge for P-matrices only, whose solution is the only one and the least for Z. A small matrix that they
  // do not solve has every fallback of the dense solvers; a large one can still be the M of a march.
  if (!plan.converges && M.rows() <= largest_written_out && shift == 0)
    return make_dense_lcp(Matrix(M), lcp_class, rows, team);
  return std::make_unique<SparseLcp>(M, shift, plan, 0, rows, team);
}

}  // namespace bromwich::cpu

// Batched complementarity problems with one small dense matrix.
//
// Up to `largest_lane_size` constraints, eight problems share the lanes of a vector. A Newton sweep eliminates, without
// row exchanges, the matrix that equals M on the active set and the identity elsewhere. All leading minors of a
// P-matrix are positive; a row whose pivot fails is left to pivoting. Larger matrices go row by row to the active-set
// solver, which keeps its transform between time points. The lanes work on R M C, whose rows and columns have
// comparable size (core/lcp/solution.hpp). For a PSD matrix a lane counts as solved only if its solution is certainly
// unique.

#include "cpu/lcp_batch.hpp"

namespace bromwich::cpu {

namespace {

constexpr Index largest_lane_size = 16;

class LaneLcp final : public ImmediateLcpBatch {
 public:
  LaneLcp(const Matrix& M, LcpClass lcp_class, Index rows, Team& team)
      : n_(M.rows()),
        original_(M),
        scale_(equilibrate(M)),
        M_(scaled(M, scale_)),
        class_(selection_class(M, lcp_class)),
        row_blocks_(rows, M.size(), team),
        team_(team),
        pivoting_(M, class_),
        q_(n_),
        fresh_(n_) {}

  LcpReport solve_now(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    const RowMatrix &R = host(r), &V = host(v);
    RowMatrix& Y = host(y);
    return row_blocks_.run(
        first, R.rows(), lanes, settle_tolerance,
        [&](Index begin, Index size, int, BlockOutcome& outcome, double* change, double* magnitude) {
          newton(R, V, Y, begin, size, outcome, change, magnitude);
        },
        [&](Index j, double& change, double& magnitude) {
          q_ = R.row(j) + V.row(j);
          return pivot_row(pivoting_, q_, Y.row(j).data(), fresh_, change, magnitude);
        });
  }

  double residual(const Array& r, const Array& v, const Array& y) override {
    return natural_residual(original_, host(r), host(v), host(y), team_);
  }

  std::size_t bytes() const override { return row_blocks_.bytes() + 4 * sizeof(double) * std::size_t(M_.size()); }

 private:
  struct Block {
    Lanes q[largest_lane_size], old[largest_lane_size], y[largest_lane_size], active[largest_lane_size];
    Lanes a[largest_lane_size][largest_lane_size];
  };

  void gather(const RowMatrix& R, const RowMatrix& V, const RowMatrix& Y, Index begin, Index size, Block& s) const {
    for (Index i = 0; i < n_; ++i) {
      s.q[i] = all(1);  // rows past the end: y = 0
      s.old[i] = all(0);
      for (Index k = 0; k < size; ++k) {
        s.q[i][k] = scale_.rows[i] * (R.data()[(begin + k) * n_ + i] + V.data()[(begin + k) * n_ + i]);
        s.old[i][k] = Y.data()[(begin + k) * n_ + i];
      }
      s.active[i] = s.old[i] > 0 ? all(1) : all(0);
    }
  }

  // y_S = -M_SS^{-1} q_S, 0 elsewhere. Returns the lanes whose pivots were all positive beyond rounding.
  LaneMask eliminate(Block& s) const {
    LaneMask positive = all(0) == all(0);
    for (Index i = 0; i < n_; ++i) {
      for (Index k = 0; k < n_; ++k) s.a[i][k] = s.active[i] * s.active[k] * M_(i, k);
      s.a[i][i] += 1 - s.active[i];
      s.y[i] = -s.active[i] * s.q[i];
    }
    for (Index k = 0; k < n_; ++k) {
      positive &= s.a[k][k] > 16 * double(n_) * epsilon * M_(k, k);
      const Lanes inverse = 1 / s.a[k][k];
      s.a[k][k] = inverse;
      for (Index i = k + 1; i < n_; ++i) {
        const Lanes factor = s.a[i][k] * inverse;
        for (Index j = k + 1; j < n_; ++j) s.a[i][j] -= factor * s.a[k][j];
        s.y[i] -= factor * s.y[k];
      }
    }
    for (Index i = n_ - 1; i >= 0; --i) {
      for (Index k = i + 1; k < n_; ++k) s.y[i] -= s.a[i][k] * s.y[k];
      s.y[i] *= s.a[i][i];
    }
    return positive;
  }

  // Flips the indices with the wrong sign; returns the lanes without any.
  LaneMask exchange(Block& s, Lanes tolerance) const {
    LaneMask same = all(0) == all(0);
    for (Index i = 0; i < n_; ++i) {
      Lanes w = s.q[i];
      for (Index k = 0; k < n_; ++k) w += M_(i, k) * s.y[k];
      const Lanes value = s.active[i] > 0.5 ? s.y[i] : w;
      const LaneMask flip = value < -tolerance;
      same &= ~flip;
      s.active[i] = flip ? 1 - s.active[i] : s.active[i];
    }
    return same;
  }

  void newton(const RowMatrix& R, const RowMatrix& V, RowMatrix& Y, Index begin, Index size, BlockOutcome& outcome,
              double* change, double* magnitude) const {
    Block s;
    gather(R, V, Y, begin, size, s);
    Lanes tolerance = all(0);
    for (Index i = 0; i < n_; ++i) tolerance = max(tolerance, abs(s.q[i]));
    tolerance *= 16 * epsilon;
    LaneMask same = all(0) != all(0), positive = same;
    const int cap = 8 + int(n_);
    for (int count = 1; count <= cap && any(~same); ++count) {
      for (Index lane = 0; lane < lanes; ++lane)
        if (!same[lane]) outcome.sweeps[lane] = count;
      positive = eliminate(s);
      same = exchange(s, tolerance);
    }
    Lanes largest_change = all(0), largest = all(0), sum = all(0);
    for (Index i = 0; i < n_; ++i) {
      sum += s.q[i] + s.y[i];
      s.y[i] = s.y[i] < 0 ? all(0) : scale_.columns[i] * s.y[i];
      largest_change = max(largest_change, abs(s.y[i] - s.old[i]));
      largest = max(largest, s.y[i]);
    }
    for (Index k = 0; k < size; ++k) {
      const bool finite = std::isfinite(sum[k]);
      outcome.solved[k] = finite && same[k] && (!selects_least(class_) || positive[k]) &&
                          (!selects_least_norm(class_) || is_only_solution(s, k));
      change[k] = finite ? largest_change[k] : NAN;
      magnitude[k] = largest[k];
      if (outcome.solved[k])
        for (Index i = 0; i < n_; ++i) Y.data()[(begin + k) * n_ + i] = s.y[i][k];
    }
  }

  bool is_only_solution(const Block& s, Index lane) const {
    Vector q(n_), y(n_);
    for (Index i = 0; i < n_; ++i) {
      q[i] = s.q[i][lane];
      y[i] = s.y[i][lane] / scale_.columns[i];
    }
    return is_certainly_unique(M_, q, y);
  }

  Index n_;
  Matrix original_;
  Equilibration scale_;
  Matrix M_;  ///< R M C
  LcpClass class_;
  RowBlocks row_blocks_;
  Team& team_;
  ActiveSetLcp pivoting_;
  Vector q_, fresh_;
};

class RowLcp final : public ImmediateLcpBatch {
 public:
  RowLcp(const Matrix& M, LcpClass lcp_class, Index rows, Team& team)
      : M_(M), class_(selection_class(M, lcp_class)), row_blocks_(rows, M.size(), team), team_(team) {
    for (int t = 0; t < team.threads(); ++t)
      solvers_.push_back({ActiveSetLcp(M, class_), Vector(M.rows()), Vector(M.rows())});
  }

  LcpReport solve_now(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    const RowMatrix &R = host(r), &V = host(v);
    RowMatrix& Y = host(y);
    const auto one_row = [&](Index j, Worker& s, double& change, double& magnitude) {
      s.q = R.row(j) + V.row(j);
      s.y = Y.row(j);
      s.solver.start_from(s.y);
      const LcpOutcome outcome = s.solver.solve(s.q, s.y);
      change = s.q.allFinite() ? (s.y.transpose() - Y.row(j)).cwiseAbs().maxCoeff() : NAN;
      magnitude = s.y.cwiseAbs().maxCoeff();
      Y.row(j) = s.y.transpose();
      return outcome;
    };
    return row_blocks_.run(
        first, R.rows(), lanes, settle_tolerance,
        [&](Index begin, Index size, int thread, BlockOutcome& outcome, double* change, double* magnitude) {
          for (Index k = 0; k < size; ++k) {
            const LcpOutcome o = one_row(begin + k, solvers_[std::size_t(thread)], change[k], magnitude[k]);
            outcome.solved[k] = o.solved;
            outcome.sweeps[k] = o.newton;
          }
        },
        [&](Index j, double& change, double& magnitude) {
          solvers_[0].solver.reset();
          return one_row(j, solvers_[0], change, magnitude);
        });
  }

  double residual(const Array& r, const Array& v, const Array& y) override {
    return natural_residual(M_, host(r), host(v), host(y), team_);
  }

  std::size_t bytes() const override {
    return row_blocks_.bytes() + sizeof(double) * std::size_t(M_.size()) * (1 + 2 * solvers_.size());
  }

 private:
  struct Worker {
    ActiveSetLcp solver;
    Vector q, y;
  };

  Matrix M_;
  LcpClass class_;
  RowBlocks row_blocks_;
  Team& team_;
  std::vector<Worker> solvers_;
};

}  // namespace

std::unique_ptr<LcpBatch> make_dense_lcp(const Matrix& M, LcpClass lcp_class, Index rows, Team& team) {
  if (M.rows() <= largest_lane_size) return std::make_unique<LaneLcp>(M, lcp_class, rows, team);
  return std::make_unique<RowLcp>(M, lcp_class, rows, team);
}

}  // namespace bromwich::cpu

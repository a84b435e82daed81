// Batched complementarity problems with one tridiagonal matrix.
//
// Rows of the space-time array are transposed into lanes, sixteen problems at a time (two vectors, so that the
// divisions of one hide behind those of the other). A Newton sweep solves the system that equals M on the active set
// and the identity elsewhere by the Thomas algorithm, eliminating downwards and substituting upwards, and finds the
// indices to exchange on the way up. Memory per sweep: everything of a block stays in L1/L2; q is read and y written
// once. Rows and columns are scaled to comparable size (core/lcp/solution.hpp) as q comes in and y goes out. For a PSD
// matrix a lane counts as solved only where its solution is certainly the only one.

#include "cpu/lcp_batch.hpp"

namespace bromwich::cpu {

namespace {

constexpr Index pair = 2;
constexpr Index width = pair * lanes;

struct Pair {
  Lanes v[pair];
};

// Workspace of one thread: q, y, the eliminated superdiagonal and right-hand side, and the active set as 0.0 or 1.0.
struct Workspace {
  explicit Workspace(Index n) : q(std::size_t(n)), y(q.size()), c(q.size()), d(q.size()), active(q.size()) {}
  std::vector<Pair> q, y, c, d, active;
};

class TridiagonalLcp final : public LcpBatch {
 public:
  TridiagonalLcp(const Tridiagonal& M, LcpClass lcp_class, Index rows, int threads)
      : n_(M.diagonal.size()),
        original_(M),
        scale_(equilibrate(M)),
        M_(std::get<Tridiagonal>(scaled(M, scale_))),
        class_(selection_class(M, lcp_class)),
        row_blocks_(rows, threads),
        threads_(threads),
        q_(n_),
        fresh_(n_) {
    for (int t = 0; t < threads; ++t) work_.emplace_back(n_);
    if (n_ == 0) return;
    for (Tridiagonal* t : {&M_, &original_}) t->lower[0] = t->upper[n_ - 1] = 0;
  }

  LcpReport solve(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    const RowMatrix &R = host(r), &V = host(v);
    RowMatrix& Y = host(y);
    return row_blocks_.run(
        first, R.rows(), width, settle_tolerance,
        [&](Index begin, Index size, int thread, BlockOutcome& outcome, double* change, double* magnitude) {
          newton(R, V, Y, begin, size, work_[std::size_t(thread)], outcome, change, magnitude);
        },
        [&](Index j, double& change, double& magnitude) {
          // Made when first needed: it is dense, and most scenes never get here.
          if (!pivoting_) pivoting_ = std::make_unique<ActiveSetLcp>(to_dense(LcpMatrix(original_)), class_);
          q_ = R.row(j) + V.row(j);
          return pivot_row(*pivoting_, q_, Y.row(j).data(), fresh_, change, magnitude);
        });
  }

  double residual(const Array& r, const Array& v, const Array& y) override {
    return natural_residual(host(r), host(v), host(y), threads_, [this](const double* row, Index i) {
      const Tridiagonal& M = original_;
      const double left = i > 0 ? M.lower[i] * row[i - 1] : 0, right = i + 1 < n_ ? M.upper[i] * row[i + 1] : 0;
      return M.diagonal[i] * row[i] + left + right;
    });
  }

  std::size_t bytes() const override {
    return row_blocks_.bytes() + work_.size() * 5 * std::size_t(n_) * sizeof(Pair) +
           (pivoting_ ? 2 * sizeof(double) * std::size_t(n_ * n_) : 0);
  }

 private:
  // Lane `lane` of vector `h` is row begin + h*lanes + lane; rows past the end get q = 1, y = 0 and are solved at once.
  void gather(const RowMatrix& R, const RowMatrix& V, const RowMatrix& Y, Index begin, Index size, Workspace& s) const {
    for (Index k = 0; k < width; ++k) {
      const Index h = k / lanes, lane = k % lanes;
      if (k >= size) {
        for (Index i = 0; i < n_; ++i) s.q[std::size_t(i)].v[h][lane] = 1, s.y[std::size_t(i)].v[h][lane] = 0;
        continue;
      }
      const double *r = R.data() + (begin + k) * n_, *v = V.data() + (begin + k) * n_, *y = Y.data() + (begin + k) * n_;
      for (Index i = 0; i < n_; ++i) {
        s.q[std::size_t(i)].v[h][lane] = scale_.rows[i] * (r[i] + v[i]);
        s.y[std::size_t(i)].v[h][lane] = y[i];
      }
    }
    for (Index i = 0; i < n_; ++i)
      for (Index h = 0; h < pair; ++h) s.active[std::size_t(i)].v[h] = s.y[std::size_t(i)].v[h] > 0 ? all(1) : all(0);
  }

  // c_i and d_i with y_i = d_i - c_i y_{i+1}. Returns per lane whether all pivots of active rows were positive.
  void eliminate(Workspace& s, LaneMask positive[pair]) const {
    Lanes c[pair] = {all(0), all(0)}, d[pair] = {all(0), all(0)};
    for (Index i = 0; i < n_; ++i) {
      const std::size_t k = std::size_t(i);
      for (Index h = 0; h < pair; ++h) {
        const Lanes active = s.active[k].v[h];
        const Lanes lower = active * M_.lower[i], upper = active * M_.upper[i];
        const Lanes pivot = (1 - active) + active * M_.diagonal[i] - lower * c[h];
        const Lanes inverse = 1 / pivot;
        positive[h] &= pivot > 64 * epsilon * M_.diagonal[i];  // beyond rounding
        c[h] = upper * inverse;
        d[h] = -(active * s.q[k].v[h] + lower * d[h]) * inverse;
        s.c[k].v[h] = c[h];
        s.d[k].v[h] = d[h];
      }
    }
  }

  // One sweep: y for the current active sets, then the exchanges. Returns per lane whether nothing was exchanged.
  void sweep(Workspace& s, const Lanes tolerance[pair], LaneMask same[pair], LaneMask positive[pair],
             Pair* fresh) const {
    for (Index h = 0; h < pair; ++h) same[h] = positive[h] = all(0) == all(0);
    eliminate(s, positive);
    Pair next = {{all(0), all(0)}};  // y_{i+1}
    Pair present = s.d[std::size_t(n_ - 1)];
    for (Index i = n_ - 1; i >= 0; --i) {
      const std::size_t k = std::size_t(i);
      Pair previous = {{all(0), all(0)}};
      for (Index h = 0; h < pair; ++h) {
        if (i > 0) previous.v[h] = s.d[k - 1].v[h] - s.c[k - 1].v[h] * present.v[h];
        const Lanes active = s.active[k].v[h], y = present.v[h];
        const Lanes w = s.q[k].v[h] + M_.lower[i] * previous.v[h] + M_.diagonal[i] * y + M_.upper[i] * next.v[h];
        const Lanes value = active > 0.5 ? y : w;
        const LaneMask flip = value < -tolerance[h];
        same[h] &= ~flip;
        s.active[k].v[h] = flip ? 1 - active : active;
        fresh[k].v[h] = y;
      }
      next = present;
      present = previous;
    }
  }

  void newton(const RowMatrix& R, const RowMatrix& V, RowMatrix& Y, Index begin, Index size, Workspace& s,
              BlockOutcome& outcome, double* change, double* magnitude) const {
    gather(R, V, Y, begin, size, s);
    Lanes tolerance[pair];
    LaneMask done[pair], least[pair];
    for (Index h = 0; h < pair; ++h) {
      Lanes largest = all(0);
      for (Index i = 0; i < n_; ++i) largest = max(largest, abs(s.q[std::size_t(i)].v[h]));
      // Rounding of M y + q: a handful of operations of the size of q for a well-scaled M.
      tolerance[h] = 16 * epsilon * largest;
      done[h] = all(0) != all(0);
      least[h] = done[h];
    }
    const int cap = 12 + int(std::min<Index>(n_, 40));
    for (int count = 1; count <= cap; ++count) {
      LaneMask same[pair], positive[pair];
      sweep(s, tolerance, same, positive, s.d.data());
      bool open = false;
      for (Index h = 0; h < pair; ++h) {
        for (Index lane = 0; lane < lanes; ++lane)
          if (!done[h][lane]) outcome.sweeps[h * lanes + lane] = count;
        done[h] = same[h];
        least[h] = positive[h];
        open = open || any(~same[h]);
      }
      if (!open) break;
    }
    finish(Y, begin, size, s, done, least, outcome, change, magnitude);
  }

  void finish(RowMatrix& Y, Index begin, Index size, const Workspace& s, const LaneMask done[pair],
              const LaneMask least[pair], BlockOutcome& outcome, double* change, double* magnitude) const {
    for (Index h = 0; h < pair; ++h) {
      Lanes largest_change = all(0), largest = all(0), sum = all(0);
      for (Index i = 0; i < n_; ++i) {
        const std::size_t k = std::size_t(i);
        const Lanes y = s.d[k].v[h] < 0 ? all(0) : scale_.columns[i] * s.d[k].v[h];
        const Lanes step = abs(y - s.y[k].v[h]);
        largest_change = max(largest_change, step);
        largest = max(largest, y);
        sum += s.q[k].v[h] + y;  // a NaN or an infinity ends here
      }
      for (Index lane = 0; lane < lanes; ++lane) {
        const Index k = h * lanes + lane;
        if (k >= size) continue;
        const bool finite = std::isfinite(sum[lane]);
        // For a Z-matrix the solution is the least one exactly when the active block has positive pivots.
        outcome.solved[k] = finite && done[h][lane] && (class_ != LcpClass::Z || least[h][lane]) &&
                            (class_ != LcpClass::PSD || is_only_solution(s, h, lane));
        change[k] = finite ? largest_change[lane] : NAN;
        magnitude[k] = largest[lane];
        if (outcome.solved[k])
          for (Index i = 0; i < n_; ++i)
            Y(begin + k, i) = scale_.columns[i] * std::max(s.d[std::size_t(i)].v[h][lane], 0.0);
      }
    }
  }

  bool is_only_solution(const Workspace& s, Index h, Index lane) const {
    Vector q(n_), y(n_);
    for (Index i = 0; i < n_; ++i) {
      q[i] = s.q[std::size_t(i)].v[h][lane];
      y[i] = std::max(s.d[std::size_t(i)].v[h][lane], 0.0);
    }
    return is_certainly_unique(M_, q, y);
  }

  Index n_;
  Tridiagonal original_;
  Equilibration scale_;
  Tridiagonal M_;  ///< R M C
  LcpClass class_;
  RowBlocks row_blocks_;
  int threads_;
  std::vector<Workspace> work_;
  std::unique_ptr<ActiveSetLcp> pivoting_;
  Vector q_, fresh_;
};

}  // namespace

std::unique_ptr<LcpBatch> make_tridiagonal_lcp(const Tridiagonal& M, LcpClass lcp_class, Index rows, int threads) {
  return std::make_unique<TridiagonalLcp>(M, lcp_class, rows, threads);
}

}  // namespace bromwich::cpu

// Batched complementarity problems with one tridiagonal matrix.
//
// Rows of the space-time array are transposed into lanes: sixteen problems at a time (two vectors, so that divisions of
// one overlap those of the other), eight columns at a time. A Newton sweep solves, by the Thomas algorithm, the system
// that equals M on the active set and the identity elsewhere. It eliminates from the first index to the last,
// substitutes back, and finds the indices to flip during the back substitution.
//
// A warm block, whose active sets are already those of its solution, takes two passes. The first reads q = r + v and
// eliminates. The second substitutes, checks and writes y. Blocks that do not settle take further sweeps in the
// workspace, which stays in L2: 4 numbers per value, 5 with the active set. Memory traffic per block: r, v and y are
// read and y is written once. A shift D adds none, since the old y is read anyway. Rows and columns are scaled to
// comparable size (core/lcp/solution.hpp) as q is read and y written. For a PSD matrix a lane counts as solved only if
// its solution is certainly unique.

#include "cpu/lcp_batch.hpp"

namespace bromwich::cpu {

namespace {

constexpr Index pair = 2;
constexpr Index width = pair * lanes;

/// One column of eight problems: q, the old y, and the eliminated system y_i = d_i - c_i y_{i+1}. After a sweep in the
/// workspace d holds the solution.
struct Cell {
  Lanes q, y, c, d;
};
struct Column {
  Cell of[pair];
};
struct ActivePair {
  LaneMask of[pair];
};

struct Workspace {
  explicit Workspace(Index n) : columns(std::size_t(n)), active(columns.size()) {}
  std::vector<Column> columns;
  std::vector<ActivePair> active;
};

/// A block of rows in the three arrays: `size` rows.
struct Rows {
  const double *r, *v;
  double* y;
  Index n, size;

  Index of(Index h) const { return std::clamp<Index>(size - h * lanes, 0, lanes); }
  Index at(Index h, Index k) const { return (h * lanes + k) * n; }
};

/// Up to eight columns, moved as a full vector if the rows have eight. The last vector is then shifted back over
/// columns of the one before: they are loaded twice, and the later store of their own vector overwrites them.
struct Columns {
  Index begin, size, from;  ///< columns begin .. begin+size-1, moved as from .. from+7

  Columns(Index begin, Index n) : begin(begin), size(std::min(lanes, n - begin)), from(std::min(begin, n - lanes)) {}

  Index lane(Index column) const { return from < 0 ? column : begin - from + column; }

  Lanes load(const double* row) const {
    if (from >= 0) return cpu::load(row + from);
    Lanes v = all(0);
    for (Index k = 0; k < size; ++k) v[k] = row[k];
    return v;
  }
  void store(double* row, const Lanes& v) const {
    if (from >= 0) return cpu::store(row + from, v);
    for (Index k = 0; k < size; ++k) row[k] = v[k];
  }
};

/// State of the lanes of one vector after a sweep.
struct Lap {
  LaneMask same = all(0) == all(0);      ///< nothing to flip
  LaneMask positive = all(0) == all(0);  ///< all pivots of active rows positive beyond rounding
  Lanes tolerance = all(0);              ///< rounding error of M y + q: a few operations of the size of q
  Lanes change = all(0), largest = all(0);
  Lanes sum = all(0);  ///< not finite if any value was not
};

class TridiagonalLcp final : public ImmediateLcpBatch {
 public:
  TridiagonalLcp(const Tridiagonal& M, LcpClass lcp_class, double shift, Index rows, Team& team)
      : n_(M.diagonal.size()),
        shift_(shift),
        original_(M),
        shifted_(plus_identity(M, shift)),
        scale_(equilibrate(shifted_)),
        M_(scaled(shifted_, scale_)),
        class_(selection_class(shifted_, lcp_class)),
        row_blocks_(rows, M.diagonal.size(), team),
        team_(team),
        q_(n_),
        fresh_(n_) {
    for (int t = 0; t < team.threads(); ++t) work_.emplace_back(n_);
    if (n_ == 0) return;
    for (Tridiagonal* t : {&M_, &original_, &shifted_}) t->lower[0] = t->upper[n_ - 1] = 0;
  }

  LcpReport solve_now(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    const RowMatrix &R = host(r), &V = host(v);
    RowMatrix& Y = host(y);
    return row_blocks_.run(
        first, R.rows(), width, settle_tolerance,
        [&](Index begin, Index size, int thread, BlockOutcome& outcome, double* change, double* magnitude) {
          const Index at = begin * n_;
          const Rows rows{R.data() + at, V.data() + at, Y.data() + at, n_, size};
          newton(rows, work_[std::size_t(thread)], outcome, change, magnitude);
        },
        [&](Index j, double& change, double& magnitude) {
          // Made when first needed: it is dense, and most scenes never use it.
          if (!pivoting_) pivoting_ = std::make_unique<ActiveSetLcp>(to_dense(LcpMatrix(shifted_)), class_);
          q_ = R.row(j) + V.row(j) - shift_ * Y.row(j);  // an unsolved row still has its old y
          return pivot_row(*pivoting_, q_, Y.row(j).data(), fresh_, change, magnitude);
        });
  }

  double residual(const Array& r, const Array& v, const Array& y) override {
    return natural_residual(host(r), host(v), host(y), team_,
                            [this](const double* row, double* product) { multiply(original_, row, product); });
  }

  std::size_t bytes() const override {
    return row_blocks_.bytes() + work_.size() * std::size_t(n_) * (sizeof(Column) + sizeof(ActivePair)) +
           (pivoting_ ? 2 * sizeof(double) * std::size_t(n_ * n_) : 0);
  }

 private:
  // Loads eight columns of eight rows into lanes. Rows past the end get q = 1, y = 0, which is solved at once.
  void gather(const Rows& rows, Index h, const Columns& at, Lanes q[lanes], Lanes y[lanes]) const {
    const Lanes scale = at.load(scale_.rows.data());
    const Index given = rows.of(h);
    for (Index k = 0; k < given; ++k) {
      const Index row = rows.at(h, k);
      y[k] = at.load(rows.y + row);
      q[k] = scale * (at.load(rows.r + row) + at.load(rows.v + row) - shift_ * y[k]);
    }
    for (Index k = given; k < lanes; ++k) q[k] = all(1), y[k] = all(0);
    transpose(q);
    transpose(y);
  }

  static void scatter(const Rows& rows, Index h, const Columns& at, Lanes y[lanes]) {
    transpose(y);
    for (Index k = 0; k < rows.of(h); ++k) at.store(rows.y + rows.at(h, k), y[k]);
  }

  // c_i and d_i from the row above; `pivots` keeps the smallest excess of a pivot over its rounding error.
  void eliminate(Index i, LaneMask active, const Lanes& q, Lanes& c, Lanes& d, Lanes& pivots) const {
    const Lanes pivot = active ? M_.diagonal[i] - M_.lower[i] * c : all(1);
    const Lanes inverse = 1 / pivot;
    pivots = min(pivots, pivot - 64 * epsilon * M_.diagonal[i]);
    c = active ? M_.upper[i] * inverse : all(0);
    d = active ? -(q + M_.lower[i] * d) * inverse : all(0);
  }

  // First pass: loads a block and eliminates the system of the active set given by y.
  void come_in(const Rows& rows, Workspace& s, Lap lap[pair]) const {
    Lanes c[pair] = {all(0), all(0)}, d[pair] = {all(0), all(0)}, q_size[pair] = {all(0), all(0)};
    Lanes y_size[pair] = {all(0), all(0)}, pivots[pair] = {all(1), all(1)};
    for (Index first = 0; first < n_; first += lanes) {
      const Columns at(first, n_);
      Lanes q[pair][lanes], y[pair][lanes];
      for (Index h = 0; h < pair; ++h) gather(rows, h, at, q[h], y[h]);
      for (Index k = 0; k < at.size; ++k)
        for (Index h = 0; h < pair; ++h) {
          const Index i = first + k;
          const Lanes &qi = q[h][at.lane(k)], &yi = y[h][at.lane(k)];
          eliminate(i, yi > 0, qi, c[h], d[h], pivots[h]);
          q_size[h] = max(q_size[h], abs(qi));
          y_size[h] = max(y_size[h], yi);
          s.columns[std::size_t(i)].of[h] = {qi, yi, c[h], d[h]};
        }
    }
    for (Index h = 0; h < pair; ++h) {
      lap[h].tolerance = 16 * epsilon * q_size[h];
      lap[h].largest = y_size[h];
      lap[h].positive = pivots[h] > 0;
    }
  }

  // Returns y_{i-1} and sets w to w_i.
  Lanes substitute(const Workspace& s, Index i, Index h, const Lanes& present, const Lanes& next, Lanes& w) const {
    const Cell& cell = s.columns[std::size_t(i)].of[h];
    Lanes previous = all(0);
    if (i > 0) {
      const Cell& above = s.columns[std::size_t(i - 1)].of[h];
      previous = above.d - above.c * present;
    }
    w = cell.q + M_.lower[i] * previous + M_.diagonal[i] * present + M_.upper[i] * next;
    return previous;
  }

  Lanes in_units_of_the_caller(Index i, const Lanes& y) const { return scale_.columns[i] * max(y, all(0)); }

  // Second pass: substitutes and writes y, whether or not it is the solution.
  void go_out(const Rows& rows, const Workspace& s, Lap lap[pair]) const {
    Lanes next[pair] = {all(0), all(0)}, present[pair];
    Lanes lowest[pair] = {all(0), all(0)}, change[pair] = {all(0), all(0)}, largest[pair] = {all(0), all(0)};
    Lanes sum[pair] = {all(0), all(0)};
    for (Index h = 0; h < pair; ++h) present[h] = s.columns[std::size_t(n_ - 1)].of[h].d;
    for (Index first = (n_ - 1) / lanes * lanes; first >= 0; first -= lanes) {
      const Columns at(first, n_);
      Lanes out[pair][lanes];
      for (Index k = at.size - 1; k >= 0; --k)
        for (Index h = 0; h < pair; ++h) {
          const Index i = first + k;
          const Cell& cell = s.columns[std::size_t(i)].of[h];
          Lanes w;
          const Lanes previous = substitute(s, i, h, present[h], next[h], w);
          const Lanes value = in_units_of_the_caller(i, present[h]);
          lowest[h] = min(lowest[h], cell.y > 0 ? present[h] : w);
          change[h] = max(change[h], abs(value - cell.y));
          largest[h] = max(largest[h], value);
          sum[h] += w;
          out[h][at.lane(k)] = value;
          next[h] = present[h];
          present[h] = previous;
        }
      for (Index h = 0; h < pair; ++h) scatter(rows, h, at, out[h]);
    }
    for (Index h = 0; h < pair; ++h) {
      lap[h].same = lowest[h] >= -lap[h].tolerance;
      lap[h].change = change[h];
      lap[h].largest = largest[h];
      lap[h].sum = sum[h];
    }
  }

  // One sweep in the workspace: y for the current active sets, then the flips.
  void sweep(Workspace& s, Lap lap[pair]) const {
    Lanes c[pair] = {all(0), all(0)}, d[pair] = {all(0), all(0)}, pivots[pair] = {all(1), all(1)};
    LaneMask same[pair] = {all(0) == all(0), all(0) == all(0)};
    for (Index i = 0; i < n_; ++i)
      for (Index h = 0; h < pair; ++h) {
        Cell& cell = s.columns[std::size_t(i)].of[h];
        eliminate(i, s.active[std::size_t(i)].of[h], cell.q, c[h], d[h], pivots[h]);
        cell.c = c[h];
        cell.d = d[h];
      }
    Lanes next[pair] = {all(0), all(0)}, present[pair] = {d[0], d[1]};
    for (Index i = n_ - 1; i >= 0; --i)
      for (Index h = 0; h < pair; ++h) {
        LaneMask& active = s.active[std::size_t(i)].of[h];
        Lanes w;
        const Lanes previous = substitute(s, i, h, present[h], next[h], w);
        const LaneMask flip = (active ? present[h] : w) < -lap[h].tolerance;
        same[h] &= ~flip;
        active ^= flip;
        s.columns[std::size_t(i)].of[h].d = present[h];
        next[h] = present[h];
        present[h] = previous;
      }
    for (Index h = 0; h < pair; ++h) {
      lap[h].same = same[h];
      lap[h].positive = pivots[h] > 0;
    }
  }

  void newton(const Rows& rows, Workspace& s, BlockOutcome& outcome, double* change, double* magnitude) const {
    if (n_ == 0) return;
    Lap lap[pair];
    come_in(rows, s, lap);
    // The uniqueness check of a PSD matrix needs a solution in the workspace. A start from y = 0 has no active set to
    // try.
    if (!selects_least_norm(class_) && any((lap[0].largest > 0) | (lap[1].largest > 0))) {
      lap[0].largest = lap[1].largest = all(0);
      go_out(rows, s, lap);
      std::fill_n(outcome.sweeps, rows.size, 1);
      if (!any(~settled(lap[0]) | ~settled(lap[1]))) return report(rows, s, lap, outcome, change, magnitude);
    }
    for (Index i = 0; i < n_; ++i)
      for (Index h = 0; h < pair; ++h) s.active[std::size_t(i)].of[h] = s.columns[std::size_t(i)].of[h].y > 0;
    for (Lap& one : lap) one.same = all(0) != all(0);
    const int cap = 12 + int(std::min<Index>(n_, 40));
    for (int count = 1; count <= cap && any(~lap[0].same | ~lap[1].same); ++count) {
      for (Index k = 0; k < rows.size; ++k)
        if (!lap[k / lanes].same[k % lanes]) outcome.sweeps[k] = count;
      sweep(s, lap);
    }
    write_back(rows, s, lap, outcome, change, magnitude);
  }

  // Lanes whose active set is that of the wanted solution. For a Z-matrix this is the least one, which has positive
  // pivots of the active block.
  LaneMask settled(const Lap& lap) const { return selects_least(class_) ? lap.same & lap.positive : lap.same; }

  // Writes the solutions of the workspace; unsolved rows get their old y back.
  void write_back(const Rows& rows, const Workspace& s, Lap lap[pair], BlockOutcome& outcome, double* change,
                  double* magnitude) const {
    for (Index h = 0; h < pair; ++h) {
      lap[h].change = lap[h].largest = lap[h].sum = all(0);
      for (Index i = 0; i < n_; ++i) {
        const Cell& cell = s.columns[std::size_t(i)].of[h];
        const Lanes value = in_units_of_the_caller(i, cell.d);
        lap[h].change = max(lap[h].change, abs(value - cell.y));
        lap[h].largest = max(lap[h].largest, value);
        lap[h].sum += cell.q + cell.d;
      }
    }
    report(rows, s, lap, outcome, change, magnitude);
    for (Index h = 0; h < pair; ++h) {
      LaneMask solved;
      for (Index lane = 0; lane < lanes; ++lane) solved[lane] = outcome.solved[h * lanes + lane] ? -1 : 0;
      for (Index first = (n_ - 1) / lanes * lanes; first >= 0; first -= lanes) {
        const Columns at(first, n_);
        Lanes out[lanes] = {};
        for (Index k = 0; k < at.size; ++k) {
          const Cell& cell = s.columns[std::size_t(first + k)].of[h];
          out[at.lane(k)] = solved ? in_units_of_the_caller(first + k, cell.d) : cell.y;
        }
        scatter(rows, h, at, out);
      }
    }
  }

  void report(const Rows& rows, const Workspace& s, const Lap lap[pair], BlockOutcome& outcome, double* change,
              double* magnitude) const {
    for (Index k = 0; k < rows.size; ++k) {
      const Index h = k / lanes, lane = k % lanes;
      const bool finite = std::isfinite(lap[h].sum[lane]);
      outcome.solved[k] =
          finite && settled(lap[h])[lane] && (!selects_least_norm(class_) || is_only_solution(s, h, lane));
      change[k] = finite ? lap[h].change[lane] : NAN;
      magnitude[k] = lap[h].largest[lane];
    }
  }

  bool is_only_solution(const Workspace& s, Index h, Index lane) const {
    Vector q(n_), y(n_);
    for (Index i = 0; i < n_; ++i) {
      q[i] = s.columns[std::size_t(i)].of[h].q[lane];
      y[i] = std::max(s.columns[std::size_t(i)].of[h].d[lane], 0.0);
    }
    return is_certainly_unique(M_, q, y);
  }

  Index n_;
  double shift_;          ///< D
  Tridiagonal original_;  ///< M
  Tridiagonal shifted_;   ///< M + D I
  Equilibration scale_;
  Tridiagonal M_;  ///< R (M + D I) C
  LcpClass class_;
  RowBlocks row_blocks_;
  Team& team_;
  std::vector<Workspace> work_;
  std::unique_ptr<ActiveSetLcp> pivoting_;
  Vector q_, fresh_;
};

}  // namespace

std::unique_ptr<LcpBatch> make_tridiagonal_lcp(const Tridiagonal& M, LcpClass lcp_class, double shift, Index rows,
                                               Team& team) {
  return std::make_unique<TridiagonalLcp>(M, lcp_class, shift, rows, team);
}

}  // namespace bromwich::cpu

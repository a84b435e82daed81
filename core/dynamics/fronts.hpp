#pragma once
// The numerical part of the multifrontal elimination of zE - A (core/numerics/elimination.hpp has the symbolic part),
// eight shifts z at a time, one per lane. All lanes have the same structure, so fronts with one or two pivots use whole
// vectors, too. A test column (zE - A) u, u = ±1, whose solution is known, is solved along with B.
//
// Symmetric A and E: what is above the diagonal of a front follows from what is below. Where N = D B^T besides, D
// diagonal, [zE - A, B; B^T, 0] is reduced instead, so that this holds for rows and columns of contacts, too. Its last
// block is -D^{-1} N (zE - A)^{-1} B.

#include "../base/simd.hpp"
#include "../numerics/elimination.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>
#include <vector>

namespace bromwich::multifrontal {

using namespace simd;

using RowSparse = Eigen::SparseMatrix<double, Eigen::RowMajor>;

struct Entry {
  Lanes re, im;
};

inline void add(Entry& a, const Entry& b) {
  a.re += b.re;
  a.im += b.im;
}

// a -= b c
inline void subtract_product(Entry& a, const Entry& b, const Entry& c) {
  a.re -= b.re * c.re;
  a.re += b.im * c.im;
  a.im -= b.re * c.im;
  a.im -= b.im * c.re;
}

// Begins to load an entry that is about to be changed.
inline void fetch(const Entry& a) {
  __builtin_prefetch(&a.re, 1);
  __builtin_prefetch(&a.im, 1);
}

inline Entry product(const Entry& b, const Entry& c) { return {b.re * c.re - b.im * c.im, b.re * c.im + b.im * c.re}; }

inline Entry inverse(const Entry& a) {
  const Lanes norm = a.re * a.re + a.im * a.im;
  return {a.re / norm, -a.im / norm};
}

/// Read by all threads: A in elimination order, B and N, the test column.
struct System {
  Elimination plan;
  bool symmetric = false;
  Vector ratio;  ///< D where N = D B^T and A and E are symmetric; else empty
  std::vector<int> position;
  SparseMatrix A, E;               ///< E with the structure of A; empty if there is no E
  RowSparse rows_of_A, rows_of_E;  ///< only if not symmetric
  RowSparse B;
  const SparseMatrix& N;
  Vector u, Au, Eu;

  System(const SparseMatrix& given_A, const SparseMatrix& given_E, const SparseMatrix& given_B, const SparseMatrix& N_)
      : A(given_E.rows() > 0 ? SparseMatrix(given_A + 0 * given_E) : given_A),
        E(given_E.rows() > 0 ? SparseMatrix(given_E + 0 * given_A) : given_E),
        B(given_B),
        N(N_),
        u(A.rows()) {
    plan = analyse(A, given_B, N, 1);
    symmetric = is_symmetric(A) && (!mass() || is_symmetric(E));
    position.resize(plan.order.size());
    for (std::size_t i = 0; i < position.size(); ++i) position[std::size_t(plan.order[i])] = int(i);
    if (symmetric) ratio = ratio_of(N, given_B);
    if (!symmetric) rows_of_A = A;
    if (!symmetric && mass()) rows_of_E = E;
    unsigned long long random = 1;
    for (double& value : u) {
      random = random * 6364136223846793005ULL + 1442695040888963407ULL;
      value = random >> 63 ? 1 : -1;
    }
    Au = A * u;
    Eu = mass() ? Vector(E * u) : u;
  }

  bool mass() const { return E.rows() > 0; }
  bool bordered() const { return ratio.size() > 0; }

  // Up to what sums of a few elements round, relative to the diagonal. The elimination reads one of two such entries.
  static bool is_symmetric(const SparseMatrix& A) {
    constexpr double rounding = 16 * epsilon;
    const SparseMatrix transposed = A.transpose(), difference = A - transposed;
    const Vector size = A.diagonal().cwiseAbs().cwiseSqrt();
    for (Index c = 0; c < difference.cols(); ++c)
      for (SparseMatrix::InnerIterator d(difference, c); d; ++d)
        if (!(std::abs(d.value()) <= rounding * size[d.row()] * size[c])) return false;
    return true;
  }

  // D of N = D B^T, B the first columns of the given ones; empty if there is none.
  static Vector ratio_of(const SparseMatrix& N, const SparseMatrix& B) {
    constexpr double rounding = 1e-15;
    if (B.cols() < N.rows()) return {};
    const SparseMatrix columns = N.transpose();
    Vector ratio(N.rows());
    for (Index i = 0; i < ratio.size(); ++i) {
      SparseMatrix::InnerIterator n(columns, i), b(B, i);
      if (!n || !b || b.value() == 0) return {};
      ratio[i] = n.value() / b.value();
      for (; n && b && n.row() == b.row(); ++n, ++b)
        if (!(std::abs(n.value() - ratio[i] * b.value()) <= rounding * std::abs(n.value()))) return {};
      if (n || b) return {};
    }
    return (ratio.array() != 0).all() ? ratio : Vector();
  }
};

/// Elimination of eight nodes by one thread.
class Fronts {
 public:
  /// A front after its elimination: l_ip below the diagonal, u_pj on it and, unless the system is symmetric, to its
  /// right. Positions from 0 to `main` are those of the pivots and of the rest.
  struct Eliminated {
    Fronts& of;
    Index pivots, main;

    const Entry& lower(Index i, Index p) const { return of.at(i, p); }
    const Entry& upper(Index p, Index j) const { return of.at(p, j); }
  };
  explicit Fronts(const System& system)
      : s_(system),
        inputs_(s_.B.cols() + 1),
        place_(s_.plan.order.size()),
        row_place_(std::size_t(s_.N.rows())),
        column_place_(std::size_t(inputs_)),
        front_(std::size_t(s_.plan.largest_front)),
        stack_(std::size_t(s_.plan.largest_stack)),
        result_(std::size_t(s_.N.rows() * inputs_)),
        U_(std::size_t(panel * (block + 1))) {}

  /// Called with each front; what it refers to lasts as long as the call.
  void keep(std::function<void(const Eliminated&)> keep) { keep_ = std::move(keep); }

  /// Afterwards result(i, c) is the entry (i, c) of N (zE - A)^{-1} [B, (zE - A) u], a lane for each z.
  void run(const Entry& z) {
    z_ = z;
    std::fill(result_.begin(), result_.end(), Entry{all(0), all(0)});
    remainders_.clear();
    top_ = 0;
    for (std::size_t f = 0; f < s_.plan.fronts.size(); ++f) {
      const Front& front = s_.plan.fronts[f];
      rows_ = front.rows();
      cols_ = front.cols();
      pivots_ = front.pivots;
      main_ = pivots_ + Index(front.rest.size());
      mirrored_ = s_.bordered() ? rows_ : s_.symmetric ? main_ : 0;
      std::fill_n(front_.begin(), rows_ * cols_, Entry{all(0), all(0)});
      find_places(front);
      assemble(front);
      for (Index c = 0; c < front.children; ++c) take_child();
      eliminate();
      if (keep_) keep_({*this, pivots_, main_});
      hand_on(front, f);
    }
  }

  Complex result(Index i, Index c, Index lane) const {
    const bool above = s_.bordered() && i < c && c < s_.N.rows();
    const Entry& e = result_[std::size_t(above ? c * inputs_ + i : i * inputs_ + c)];
    const Complex value{e.re[lane], e.im[lane]};
    return s_.bordered() ? -s_.ratio[i] * value : value;
  }

 private:
  Entry& at(Index i, Index j) { return front_[std::size_t(j * rows_ + i)]; }

  void find_places(const Front& front) {
    for (Index p = 0; p < pivots_; ++p) place_[std::size_t(front.first + p)] = int(p);
    int next = int(pivots_);
    for (const int i : front.rest) place_[std::size_t(i)] = next++;
    next = int(main_);
    for (const int i : front.outputs) row_place_[std::size_t(i)] = next++;
    next = int(main_);
    for (const int c : front.inputs) column_place_[std::size_t(c)] = next++;
  }

  // a += z e
  void add_shift(Entry& a, double e) const {
    a.re += z_.re * all(e);
    a.im += z_.im * all(e);
  }

  // Adds the entries of zE - A, B and -N in the rows and columns of the front's pivots that no earlier front has taken.
  void assemble(const Front& front) {
    const Index test = inputs_ - 1;
    for (Index p = 0; p < pivots_; ++p) {
      const Index original = s_.plan.order[std::size_t(front.first + p)];
      for (SparseMatrix::InnerIterator a(s_.A, original); a; ++a) {
        const int i = s_.position[std::size_t(a.row())];
        if (i >= front.first) at(place_[std::size_t(i)], p).re -= all(a.value());
      }
      if (!s_.mass()) {
        at(p, p).re += z_.re;
        at(p, p).im += z_.im;
      } else {
        for (SparseMatrix::InnerIterator e(s_.E, original); e; ++e) {
          const int i = s_.position[std::size_t(e.row())];
          if (i >= front.first) add_shift(at(place_[std::size_t(i)], p), e.value());
        }
        if (!s_.symmetric)
          for (RowSparse::InnerIterator e(s_.rows_of_E, original); e; ++e) {
            const int j = s_.position[std::size_t(e.col())];
            if (j >= front.first + pivots_) add_shift(at(p, place_[std::size_t(j)]), e.value());
          }
      }
      if (!s_.symmetric)
        for (RowSparse::InnerIterator a(s_.rows_of_A, original); a; ++a) {
          const int j = s_.position[std::size_t(a.col())];
          if (j >= front.first + pivots_) at(p, place_[std::size_t(j)]).re -= all(a.value());
        }
      for (RowSparse::InnerIterator b(s_.B, original); b; ++b)
        if (s_.bordered() && b.col() < s_.N.rows())
          at(row_place_[std::size_t(b.col())], p).re += all(b.value());
        else
          at(p, column_place_[std::size_t(b.col())]).re += all(b.value());
      Entry& known = at(p, column_place_[std::size_t(test)]);
      known.re += z_.re * all(s_.Eu[original]) - all(s_.Au[original]);
      known.im += z_.im * all(s_.Eu[original]);
      for (SparseMatrix::InnerIterator n(s_.N, original); n && !s_.bordered(); ++n)
        at(row_place_[std::size_t(n.row())], p).re -= all(n.value());
    }
  }

  // Adds the remainder on top of the stack to the front: rest x rest (rest x inputs), outputs x rest.
  void take_child() {
    const Front& child = s_.plan.fronts[remainders_.back()];
    remainders_.pop_back();
    top_ -= child.remainder();
    const Entry* from = &stack_[std::size_t(top_)];
    const Index rest = Index(child.rest.size()), rows = child.rows() - child.pivots, cols = child.cols() - child.pivots;
    for (Index j = 0; j < cols; ++j) {
      if (j == rest && s_.bordered()) j = rows;
      const bool in_rest = j < rest;
      const int to = in_rest ? place_[std::size_t(child.rest[std::size_t(j)])]
                             : column_place_[std::size_t(child.inputs[std::size_t(j - rest)])];
      for (Index i = in_rest && s_.symmetric ? j : 0; i < rest; ++i)
        add(at(place_[std::size_t(child.rest[std::size_t(i)])], to), from[j * rows + i]);
      for (Index i = rest; in_rest && i < rows; ++i)
        add(at(row_place_[std::size_t(child.outputs[std::size_t(i - rest)])], to), from[j * rows + i]);
    }
  }

  // Eliminates pivots in panels: L below them, U to their right, then one product for the trailing block.
  void eliminate() {
    for (Index first = 0; first < pivots_; first += panel) {
      const Index last = std::min(pivots_, first + panel);
      for (Index p = first; p < last; ++p) {
        const Entry scale = inverse(at(p, p));
        for (Index i = p + 1; i < rows_; ++i) at(i, p) = product(at(i, p), scale);
        for (Index j = p + 1; j < last; ++j) {
          // Below the diagonal only: by symmetry U is the transpose of L times the pivot.
          const Entry u = s_.symmetric ? product(at(j, p), at(p, p)) : at(p, j);
          for (Index i = s_.symmetric ? j : p + 1; i < rows_; ++i) subtract_product(at(i, j), at(i, p), u);
        }
      }
      // Blocks do not cross the column where symmetry ends.
      for (Index j = last; j < mirrored_; j += block) update_columns(first, last, j, std::min(block, mirrored_ - j));
      for (Index j = std::max(last, mirrored_); j < cols_; j += block)
        update_columns(first, last, j, std::min(block, cols_ - j));
    }
  }

  // Updates `count` columns from j on, below and to the right of the panel. A tile of L stays in the first cache while
  // it meets all columns of the block, which stay in the second one.
  void update_columns(Index first, Index last, Index j, Index count) {
    const bool symmetric = j < mirrored_;
    const Index width = last - first;
    for (Index c = 0; c < count; ++c) find_row(first, width, j + c, symmetric, &U_[std::size_t(c * width)]);
    const Index odd = (tile_columns - count % tile_columns) % tile_columns;
    std::fill_n(&U_[std::size_t(count * width)], odd * width, Entry{all(0), all(0)});
    Index i = symmetric ? j : last;
    for (; i + tile_rows <= rows_; i += tile_rows) update_row_of_tiles<tile_rows>(i, j, first, width, count, symmetric);
    for (; i < rows_; ++i) update_row_of_tiles<1>(i, j, first, width, count, symmetric);
  }

  // Column j of U in the rows of the panel.
  void find_row(Index first, Index width, Index j, bool symmetric, Entry* u) {
    for (Index p = 0; p < width; ++p) {
      if (symmetric) {
        u[p] = product(at(j, first + p), at(first + p, first + p));
        continue;
      }
      u[p] = at(first + p, j);
      for (Index q = 0; q < p; ++q) subtract_product(u[p], at(first + p, first + q), u[q]);
      if (keep_) at(first + p, j) = u[p];
    }
  }

  // By symmetry what is above the diagonal is not needed.
  template <Index height>
  void update_row_of_tiles(Index i, Index j, Index first, Index width, Index count, bool symmetric) {
    const Index columns = symmetric ? std::min(count, i + height - j) : count;
    for (Index c = 0; c < columns; c += tile_columns)
      update_tile<height>(i, j + c, first, width, &U_[std::size_t(c * width)], std::min(tile_columns, count - c));
  }

  template <Index height>
  void update_tile(Index i, Index j, Index first, Index width, const Entry* U, Index count) {
    Entry sum[height][tile_columns] = {};
    for (Index c = 0; c < count; ++c)
      for (Index k = 0; k < height; ++k) fetch(at(i + k, j + c));
    const Entry* L = &at(i, first);
    for (Index p = 0; p < width; ++p, L += rows_) {
      Entry u[tile_columns];
      for (Index c = 0; c < tile_columns; ++c) u[c] = U[c * width + p];
      for (Index k = 0; k < height; ++k) {
        const Entry l = L[k];
        for (Index c = 0; c < tile_columns; ++c) subtract_product(sum[k][c], l, u[c]);
      }
    }
    for (Index c = 0; c < count; ++c)
      for (Index k = 0; k < height; ++k) add(at(i + k, j + c), sum[k][c]);
  }

  // Adds the outputs x inputs block to the result and pushes the rest for the parent front.
  void hand_on(const Front& front, std::size_t f) {
    for (Index j = main_; j < cols_; ++j)
      for (Index i = j < mirrored_ ? j : main_; i < rows_; ++i)
        add(result_[std::size_t(front.outputs[std::size_t(i - main_)] * inputs_ +
                                front.inputs[std::size_t(j - main_)])],
            at(i, j));
    if (front.rest.empty()) return;
    Entry* to = &stack_[std::size_t(top_)];
    for (Index j = pivots_; j < cols_; ++j, to += rows_ - pivots_)
      if (!(main_ <= j && j < mirrored_)) std::copy_n(&at(pivots_, j), rows_ - pivots_, to);
    top_ += front.remainder();
    remainders_.push_back(f);
  }

  static constexpr Index panel = 32, block = 24;  // a block of U has 96 KB
#if defined(__AVX512F__)
  static constexpr Index tile_rows = 3, tile_columns = 3;  // accumulators take 18 of 32 registers
#else
  static constexpr Index tile_rows = 2, tile_columns = 1;
#endif

  const System& s_;
  std::function<void(const Eliminated&)> keep_;
  Index inputs_;
  std::vector<int> place_, row_place_, column_place_;
  std::vector<Entry> front_, stack_, result_, U_;
  std::vector<std::size_t> remainders_;
  Index top_ = 0, rows_ = 0, cols_ = 0, pivots_ = 0, main_ = 0;
  Index mirrored_ = 0;  ///< columns whose part above the diagonal follows from the rows
  Entry z_{};
};

}  // namespace bromwich::multifrontal

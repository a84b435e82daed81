#pragma once
// A few rows of a space-time array stored by columns. A product with a sparse matrix A is then one short vector
// operation per entry of A: (x A)_j = Σ_i A_ij x_i for all rows of the panel at once.

#include "../base/threads.hpp"

#include <algorithm>

namespace bromwich {

class RowPanel {
 public:
  static constexpr int height = 16;
  using Column = Eigen::Array<double, height, 1>;  ///< one value per row of the panel

  RowPanel() = default;
  explicit RowPanel(Index cols) : values_(height, cols) {}

  Index cols() const { return values_.cols(); }
  auto col(Index j) { return values_.col(j); }
  auto col(Index j) const { return values_.col(j); }
  void set_zero() { values_.setZero(); }
  /// Entries first .. first+count-1 of v, then 0.
  static Column column(const Eigen::Ref<const Vector>& v, Index first, Index count) {
    Column values = Column::Zero();
    values.head(count) = v.segment(first, count).array();
    return values;
  }

  /// Rows first .. first+count-1 of x, count <= height. Other rows of the panel, and rows outside x, are copies of the
  /// nearest one.
  void load(const Eigen::Ref<const RowMatrix>& x, Index first, Index count) {
    resize(x.cols());
    const double* from[height];
    row_starts(x, first, count, from);
    for (Index j = 0; j < x.cols(); ++j)
      for (int r = 0; r < height; ++r) values_(r, j) = from[r][j];
  }
  /// a x_i + b x_{i+1} for the rows i = first .. first+count-1.
  void load_pairs(const Eigen::Ref<const RowMatrix>& x, Index first, Index count, double a, double b) {
    resize(x.cols());
    const double *from[height], *next[height];
    row_starts(x, first, count, from);
    row_starts(x, first + 1, count, next);
    for (Index j = 0; j < x.cols(); ++j)
      for (int r = 0; r < height; ++r) values_(r, j) = a * from[r][j] + b * next[r][j];
  }
  /// Writes the panel back to the rows of x.
  void store(Eigen::Ref<RowMatrix> x, Index first, Index count) const {
    for (Index r = 0; r < count; ++r) {
      double* to = x.data() + (first + r) * x.outerStride();
      for (Index j = 0; j < cols(); ++j) to[j] = values_(r, j);
    }
  }

  /// use(j, (x A)_j) for every column j of A that has entries.
  template <typename Use>
  void each_product(const SparseMatrix& A, const Use& use) const {
    for (Index j = 0; j < A.outerSize(); ++j) {
      SparseMatrix::InnerIterator entry(A, j);
      if (!entry) continue;
      Column sum = entry.value() * values_.col(entry.row());
      for (++entry; entry; ++entry) sum += entry.value() * values_.col(entry.row());
      use(j, sum);
    }
  }
  /// (x A) · y, row by row; y may be this panel.
  Column form(const SparseMatrix& A, const RowPanel& y) const {
    Column sum = Column::Zero();
    each_product(A, [&](Index j, const Column& product) { sum += product * y.values_.col(j); });
    return sum;
  }

 private:
  void resize(Index cols) {
    if (values_.cols() != cols) values_.resize(height, cols);
  }
  static void row_starts(const Eigen::Ref<const RowMatrix>& x, Index first, Index count, const double** from) {
    for (Index r = 0; r < height; ++r)
      from[r] = x.data() + std::clamp<Index>(first + std::min(r, count - 1), 0, x.rows() - 1) * x.outerStride();
  }

  Eigen::Array<double, height, Eigen::Dynamic> values_;
};

/// Calls visit(first row, number of rows) for panels of `rows` rows with `cols` columns, on the threads of the backend
/// if one is given. make_visit() makes a visit with panels of its own for each thread.
template <typename MakeVisit>
void each_panel(const HostThreads* threads, Index rows, Index cols, const MakeVisit& make_visit) {
  const auto visit_range = [&](Index begin, Index end) {
    auto visit = make_visit();
    for (Index first = begin; first < end; first += RowPanel::height)
      visit(first, std::min<Index>(RowPanel::height, end - first));
  };
  const Index length = std::max<Index>(8, 4096 / std::max<Index>(cols, 1)) * RowPanel::height;
  if (threads)
    threads->each_range(rows, length, visit_range);
  else
    visit_range(0, rows);
}

}  // namespace bromwich

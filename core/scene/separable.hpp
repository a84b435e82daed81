#pragma once
// Sources sampled on a grid: tables, or V and a(t_j) of separable ones (core/base/time_function.hpp).

#include "../base/time_function.hpp"

#include <cstddef>

namespace bromwich {

/// Values of a source at time points, one row each: a table, or V and the rows a(t_j).
class SampledSource {
 public:
  SampledSource() = default;  ///< no rows
  explicit SampledSource(RowMatrix table) : table_(std::move(table)) {}
  SampledSource(RowMatrix amplitudes, Matrix shapes);  ///< row j = V a_j; rows x k, width x k, k >= 1

  Index rows() const { return factored() ? amplitudes_.rows() : table_.rows(); }
  Index cols() const { return factored() ? shapes_.rows() : table_.cols(); }
  Index size() const { return rows() * cols(); }
  std::size_t bytes() const;

  Vector row(Index j) const;
  /// Rows first, first + step, ... up to `count` of them.
  SampledSource rows(Index first, Index count, Index step = 1) const;
  /// The same vector added to every row.
  SampledSource plus(const Vector&) const;
  /// The first row with a value that is not finite, or -1.
  Index not_finite() const;

  bool factored() const { return shapes_.size() > 0; }
  /// The sampled rows: those of the source, or those of a, with V in `shapes` (empty otherwise).
  const RowMatrix& values() const { return factored() ? amplitudes_ : table_; }
  const Matrix& shapes() const { return shapes_; }
  /// The same with another row of `values`.
  void replace(Index j, const Vector& value);

  /// All rows on the host, computed by the first call. Not by several threads at once.
  const RowMatrix& table() const;

 private:
  RowMatrix amplitudes_;
  Matrix shapes_;
  mutable RowMatrix table_;
};

/// t_j = j T/J, j = 0..J.
Vector time_grid(double T, Index J);

/// s(t_j); zeros for an empty function.
SampledSource sample(const TimeFunction&, const Vector& t, Index width);

}  // namespace bromwich

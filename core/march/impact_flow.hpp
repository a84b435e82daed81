#pragma once
// x' = A x + c0 + c1 s + c2 s^2 from s = 0 to d, by the Taylor series of x on pieces of d that are short beside 1 /
// |A|. Only products with the sparse A are taken, so that d may be any length.

#include "../base/types.hpp"

#include <array>
#include <vector>

namespace bromwich {

/// Columns of the input, m x columns each; empty: 0.
using QuadraticColumns = std::array<Matrix, 3>;

class ImpactFlow {
 public:
  explicit ImpactFlow(const SparseMatrix& A);

  /// Pieces that a flow over d is made of.
  Index pieces(double d) const;
  /// X <- e^{dA} X + ∫_0^d e^{(d-s)A} (c0 + c1 s + c2 s^2) ds.
  void advance(double d, const QuadraticColumns& c, Matrix& X) const;
  const SparseMatrix& matrix() const { return A_; }

 private:
  const SparseMatrix& A_;
  double rate_;  ///< |A^2|^{1/2}, which changes little with the units of the states
};

/// What constant inputs over a part of any length d <= h do to outputs: C D(d) with D(d) = 1/d ∫_0^d e^{sA} B ds, as
/// polynomials of d, one for each piece of h and each entry.
class ImpactResponse {
 public:
  ImpactResponse(const ImpactFlow&, const SparseMatrix& B, const SparseMatrix& C, double h);

  /// The entry of C D(d) in this row and column.
  double at(double d, Index row, Index column) const;
  /// Rows of a column that are not 0 for all d.
  const std::vector<Index>& rows(Index column) const { return rows_[std::size_t(column)]; }

 private:
  double length_;                ///< of a piece
  Index outputs_;                ///< rows of C
  std::vector<Matrix> entries_;  ///< of each piece: coefficients x (entries, column by column), of d C D(d)
  std::vector<Matrix> terms_;    ///< of each piece: outputs x inputs, how many coefficients are more than rounding
  std::vector<std::vector<Index>> rows_;  ///< of each column
};

}  // namespace bromwich

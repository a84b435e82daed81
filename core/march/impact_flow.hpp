#pragma once
// x' = A x + c0 + c1 s + c2 s^2 from s = 0 to d, by the Taylor series of x on pieces of d that are short beside 1 / |A|.
// Only products with the sparse A are taken, so that d may be any length.

#include "../base/types.hpp"

#include <array>

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

 private:
  const SparseMatrix& A_;
  double rate_;  ///< |A^2|^{1/2}, which changes little with the units of the states
};

}  // namespace bromwich

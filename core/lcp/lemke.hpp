#pragma once
// Lemke's method for LCP(q, M): complementary pivots on w - M y - d y_0 = q, d > 0, until y_0 leaves the basis. Ties of
// the ratio test are broken lexicographically, so it always ends: with a solution or on a ray. It ends with a solution
// where the problems LCP(0, M) and LCP(d, M) have none but y = 0.

#include "matrix.hpp"

#include <vector>

namespace bromwich {

struct LemkeOutcome {
  bool solved = false;
  bool ray = false;  ///< proves infeasibility for PSD and Z matrices only
  int pivots = 0;
  Vector y;  ///< solution, where solved
  /// Indices of y in the last basis, increasing: of solutions with y_i = w_i = 0 it says which of them stays zero where
  /// q changes a little.
  std::vector<Index> basis;
  Vector direction;  ///< of y along the ray
};

/// Precondition: rows and columns of comparable scale. `cover`: d, or none: (1, ..., 1). With it q may have entries of
/// any size, as gaps of open and forces of closed contacts have: bases on the way are ill-conditioned then, and pivots
/// have more digits.
LemkeOutcome lemke(const Matrix& M, const Vector& q, const Vector& cover = {});

}  // namespace bromwich

#pragma once
// Lemke's method for LCP(q, M): complementary pivots on w - M y - d y_0 = q, d = (1, ..., 1), until y_0 leaves the
// basis. Ties of the ratio test are broken lexicographically, so it always ends: with a solution or on a ray.

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

/// Precondition: rows and columns of comparable scale.
LemkeOutcome lemke(const Matrix& M, const Vector& q);

}  // namespace bromwich

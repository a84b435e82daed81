#pragma once
// Inverses of matrices of at most eight rows, on the stack: scenes with matrices of their own need some of them each.

#include "../core/base/types.hpp"

#include <cmath>
#include <utility>

namespace bromwich {

inline constexpr Index most_short = 8;
using ShortMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor, most_short, most_short>;

/// A^{-1} by elimination with row pivoting; returns 1 / (|A|_1 |A^{-1}|_1), and 0 where A is singular or not finite.
inline double invert(ShortMatrix A, ShortMatrix& inverse) {
  const Index n = A.rows();
  const double size = n > 0 ? A.cwiseAbs().colwise().sum().maxCoeff() : 1;
  inverse = ShortMatrix::Identity(n, n);
  for (Index k = 0; k < n; ++k) {
    Index pivot = k;
    for (Index i = k + 1; i < n; ++i)
      if (std::abs(A(i, k)) > std::abs(A(pivot, k))) pivot = i;
    if (!(std::abs(A(pivot, k)) > 0)) return 0;
    for (Index j = 0; j < n && pivot != k; ++j) {
      std::swap(A(k, j), A(pivot, j));
      std::swap(inverse(k, j), inverse(pivot, j));
    }
    const double by = 1 / A(k, k);
    for (Index j = 0; j < n; ++j) A(k, j) *= by, inverse(k, j) *= by;
    for (Index i = 0; i < n; ++i) {
      const double factor = A(i, k);
      if (i == k || factor == 0) continue;
      for (Index j = 0; j < n; ++j) A(i, j) -= factor * A(k, j), inverse(i, j) -= factor * inverse(k, j);
    }
  }
  const double condition = 1 / (size * (n > 0 ? inverse.cwiseAbs().colwise().sum().maxCoeff() : 1));
  return std::isfinite(condition) ? condition : 0;
}

/// The rows and columns of M whose bits are set.
inline ShortMatrix short_block(const Matrix& M, unsigned rows, unsigned columns) {
  ShortMatrix block(M.rows(), M.cols());
  Index r = 0, width = 0;
  for (Index i = 0; i < M.rows(); ++i) {
    if (!(rows >> i & 1u)) continue;
    width = 0;
    for (Index j = 0; j < M.cols(); ++j)
      if (columns >> j & 1u) block(r, width++) = M(i, j);
    ++r;
  }
  return block.topLeftCorner(r, width);
}

}  // namespace bromwich

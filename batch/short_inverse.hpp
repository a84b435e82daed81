#pragma once
// Inverses of matrices of at most eight rows, on the stack: scenes with matrices of their own need some of them each.

#include "../core/host/set_map.hpp"

namespace bromwich {

inline constexpr Index most_short = scene_steps::most_of_set;
using ShortMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor, most_short, most_short>;

/// A^{-1}; returns its reciprocal condition, and 0 where A is singular or not finite.
inline double invert(const ShortMatrix& A, ShortMatrix& inverse) {
  inverse = A;
  return scene_steps::invert_block(A.rows(), inverse.data());
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

#pragma once

#include "../base/types.hpp"

namespace bromwich {

/// All pivots of Gaussian elimination without exchanges are positive beyond rounding. For a Z-matrix this is equivalent
/// to being a nonsingular M-matrix; its pivots do not exceed the diagonal entries.
inline bool has_positive_pivots(Matrix M) {
  const Index n = M.rows();
  const Vector level = 16 * double(n) * epsilon * M.diagonal().cwiseAbs();
  for (Index k = 0; k < n; ++k) {
    if (!(M(k, k) > level[k])) return false;
    const Index rest = n - k - 1;
    M.bottomRightCorner(rest, rest) -= M.col(k).tail(rest) * M.row(k).tail(rest) / M(k, k);
  }
  return true;
}

}  // namespace bromwich

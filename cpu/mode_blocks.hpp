#pragma once
// Neighbouring modes of a space-time array in blocks of eight, one vector each. The last block is padded with 0.

#include "cpu/simd.hpp"

#include <algorithm>

namespace bromwich::cpu {

/// Modes 8b .. 8b + 7 of a row of n values.
inline Lanes block_of_row(const double* row, Index b, Index n) {
  if ((b + 1) * lanes <= n) return load(row + b * lanes);
  Lanes values = all(0);
  for (Index i = 0; i < n - b * lanes; ++i) values[i] = row[b * lanes + i];
  return values;
}

/// `count` blocks from block `first` on, which lie side by side in each row of the array. Moving them together, row by
/// row, runs at memory bandwidth; moving them one by one misses cache and TLB at every row.
struct ModeBlocks {
  Index first = 0, count = 0;

  /// to[i stride + j] <- block i of row begin + j, j < rows.
  void gather(const RowMatrix& from, Index begin, Index rows, Lanes* to, Index stride) const {
    const Index n = from.cols(), whole = whole_blocks(n), left = n - (first + whole) * lanes;
    const double* row = from.data() + begin * n + first * lanes;
    for (Index j = 0; j < rows; ++j, row += n, ++to) {
      for (Index i = 0; i < whole; ++i) to[i * stride] = load(row + i * lanes);
      if (whole == count) continue;
      to[whole * stride] = all(0);
      for (Index e = 0; e < left; ++e) to[whole * stride][e] = row[whole * lanes + e];
    }
  }

  /// Block i of row begin + j <- from[i stride + j], j < rows.
  void scatter(const Lanes* from, Index stride, Index begin, Index rows, RowMatrix& to) const {
    const Index n = to.cols(), whole = whole_blocks(n), left = n - (first + whole) * lanes;
    double* row = to.data() + begin * n + first * lanes;
    for (Index j = 0; j < rows; ++j, row += n, ++from) {
      for (Index i = 0; i < whole; ++i) store(row + i * lanes, from[i * stride]);
      if (whole == count) continue;
      for (Index e = 0; e < left; ++e) row[whole * lanes + e] = from[whole * stride][e];
    }
  }

 private:
  Index whole_blocks(Index n) const { return std::min(count, n / lanes - first); }
};

}  // namespace bromwich::cpu

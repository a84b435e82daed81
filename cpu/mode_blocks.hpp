#pragma once
// Neighbouring modes of a space-time array in blocks of eight, which move together in one vector; in the last block
// those that are not there are 0.

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

/// `count` blocks from block `first` on. Their rows lie side by side in the array: moved together, row by row, they are
/// read and written as fast as memory allows; one by one they miss cache and page at every row.
struct ModeBlocks {
  Index first = 0, count = 0;

  /// to[i stride + j] <- block i of row begin + j, j < rows.
  void gather(const RowMatrix& from, Index begin, Index rows, Lanes* to, Index stride) const {
    const Index n = from.cols();
    const double* row = from.data() + begin * n;
    for (Index j = 0; j < rows; ++j, row += n)
      for (Index i = 0; i < count; ++i) to[i * stride + j] = block_of_row(row, first + i, n);
  }

  /// Block i of row begin + j <- from[i stride + j], j < rows.
  void scatter(const Lanes* from, Index stride, Index begin, Index rows, RowMatrix& to) const {
    const Index n = to.cols();
    double* row = to.data() + begin * n;
    for (Index j = 0; j < rows; ++j, row += n)
      for (Index i = 0; i < count; ++i) {
        const Index l = (first + i) * lanes;
        if (l + lanes <= n)
          store(row + l, from[i * stride + j]);
        else
          std::copy_n(reinterpret_cast<const double*>(from + i * stride + j), n - l, row + l);
      }
  }
};

}  // namespace bromwich::cpu

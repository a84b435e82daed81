#pragma once
// Causal convolution of eight modes by direct summation over the lags,
//
//     v_j = Σ_{d=0}^{min(D, j-1)} W_d y_{j-d} + S_j y_0.
//
// Used for modes with a short memory D (core/kernel/memory_length.hpp) and for few rows: at most D multiply-adds per
// mode and row. There is no state, so rows can be computed in any order.

#include "core/kernel/recurrence.hpp"
#include "cpu/simd.hpp"

#include <algorithm>
#include <vector>

namespace bromwich::cpu {

class DirectBlock {
 public:
  static constexpr Index own = 16;  ///< rows of v per register block
  static constexpr Index near = 8;  ///< lags per register block: 16 sums + 8 weights + a row of y fit into 32 registers

  /// Modes 8b .. 8b + 7, lags 0 .. D. A recurrence with `initial` needs D >= rows - 1. Cost O(K D).
  DirectBlock(const ModalRecurrence&, Index b, Index D);

  /// Cost per mode and row in multiply-adds of a scan: the sum, averaged over the rows, plus the weights, spread over
  /// ten calls.
  static double cost(Index D, Index rows, Index exponentials);

  /// Number of rows before row `begin` that `apply` reads.
  Index past(Index begin) const { return std::min(lags_, begin + own) + near; }

  /// Writes rows begin .. begin + count - 1 of v, begin >= 1, and pads v up to the next multiple of `own`. y[0] is row
  /// `begin`. Rows of y before row 1 must be 0; y_0 is passed separately.
  void apply(const Lanes* y, Lanes y0, Lanes* v, Index begin, Index count) const;

  std::size_t bytes() const { return sizeof(Lanes) * (weights_.size() + start_.size() + initial_.size()); }

 private:
  Index lags_;
  std::vector<Lanes> weights_;  ///< W_0 .. W_D, padded with zeros to a multiple of `near`
  std::vector<Lanes> start_;    ///< S_0 = 0, .., S_D
  std::vector<Lanes> initial_;  ///< contribution of x0 to rows 0 .. D; may be empty
};

}  // namespace bromwich::cpu

#pragma once
// Eight modes of a causal convolution as the sum that it is,
//
//     v_j = Σ_{d=0}^{min(D, j-1)} W_d y_{j-d} + S_j y_0,
//
// where they remember few lags D (core/kernel/memory_length.hpp) or there are few rows: at most D multiply-adds a mode
// and row. There is no state, so that any rows can be formed at any time.

#include "core/kernel/recurrence.hpp"
#include "cpu/simd.hpp"

#include <algorithm>
#include <vector>

namespace bromwich::cpu {

class DirectBlock {
 public:
  static constexpr Index own = 16;  ///< rows of v that are summed up together, and
  static constexpr Index near = 8;  ///< lags: 16 sums + 8 weights + a row of y fit into 32 registers

  /// Modes 8b .. 8b + 7 with the lags 0 .. D; where the recurrence has an `initial`, for D rows at most. O(K D).
  DirectBlock(const ModalRecurrence&, Index b, Index D);

  /// In multiply-adds of a scan, for a mode and row: the sum, mean over the rows, and the weights, once in ten calls.
  static double cost(Index D, Index rows, Index exponentials);

  /// Rows before row `begin` that `apply` looks at.
  Index past(Index begin) const { return std::min(lags_, begin + own) + near; }

  /// Rows begin >= 1 .. begin + count - 1 of v, and what is between `count` and the next multiple of `own`. y[0] is
  /// row `begin`; y_j is 0 before row 1, and y_0 stands apart.
  void apply(const Lanes* y, Lanes y0, Lanes* v, Index begin, Index count) const;

  std::size_t bytes() const { return sizeof(Lanes) * (weights_.size() + start_.size() + initial_.size()); }

 private:
  Index lags_;
  std::vector<Lanes> weights_;  ///< W_0 .. W_D, and zeros up to a multiple of `near`
  std::vector<Lanes> start_;    ///< S_0 = 0, .. S_D
  std::vector<Lanes> initial_;  ///< what x0 adds to rows 0 .. D; or empty
};

}  // namespace bromwich::cpu

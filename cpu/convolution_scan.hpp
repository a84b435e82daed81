#pragma once
// Eight modes of a causal convolution as a recurrence with K exponentials a mode (core/kernel/recurrence.hpp),
//
//     v_j = W_0 y_j + w1 y_{j-1} + C z_{j-1},    z_j = E z_{j-1} + y_j:
//
// 2 K multiply-adds a mode and row, however far back the modes remember.

#include "core/kernel/recurrence.hpp"
#include "cpu/simd.hpp"

#include <algorithm>
#include <memory>
#include <vector>

namespace bromwich::cpu {

/// Time runs in tiles, and the states at their starts are kept: a call can begin at any tile whose past has not
/// changed, or, after `accumulate` and `carry`, at several at once.
class ScanBlock {
 public:
  static constexpr Index tile = 128;  ///< rows; y and v of a block take 2 x 8 KB

  /// Modes 8b .. 8b + 7 of a convolution with `rows` rows.
  ScanBlock(const ModalRecurrence&, Index b, Index rows);

  /// See Convolution::start_from; b as it was made with.
  void start_from(const RowMatrix& D, Index b);

  /// Multiply-adds a mode and row.
  static double cost(const ModalRecurrence&);

  /// Tile t has the rows begin(t) = 1 + t tile .. of v; the last ends at row rows - 1.
  static Index tiles(Index rows) { return std::max<Index>(1, (rows - 1 + tile - 1) / tile); }
  static Index begin(Index t) { return 1 + t * tile; }

  /// The `count` rows of tile t of v from y, one row before it included; with `keep`, the state at the start of the
  /// next tile.
  void apply(const Lanes* y, Lanes* v, Index t, Index count, bool keep);

  /// Sets the state at the start of tile `to` to 0, and
  void clear(Index to) { std::fill_n(state(to), exponentials(), all(0)); }
  /// advances it by the rows of y of tile t, one row before it included.
  void accumulate(const Lanes* y, Index t, Index count, Index to);
  /// The states of tiles from + length, from + 2 length, .. < end, from what the tiles before each of them add.
  void carry(Index from, Index length, Index end);

  std::size_t bytes() const;

 private:
  static constexpr Index group = 8;  ///< exponentials that move together: 8 states + 8 decays + some fill 32 registers

  struct Bank {
    Lanes decay[group], output[group], start[group], initial[group];
  };

  static void advance(const Bank&, const Lanes* before, Lanes* after, const Lanes* y, Lanes* v, Index count);
  void start(Lanes y0);

  Index exponentials() const { return Index(banks_.size()) * group; }
  Lanes* state(Index t) { return states_.get() + t * exponentials(); }

  Index tiles_;
  std::vector<Bank> banks_;
  Lanes w0_, w1_, s1_;
  std::unique_ptr<Lanes[]> states_;  ///< tiles x exponentials
};

}  // namespace bromwich::cpu

#pragma once
// Causal convolution of eight modes as a recurrence with K exponentials per mode (core/seam/recurrence.hpp),
//
//     v_j = W_0 y_j + w1 y_{j-1} + C z_{j-1},    z_j = E z_{j-1} + y_j.
//
// 2 K multiply-adds per mode and row, independent of the memory length.

#include "core/kernel/recurrence.hpp"
#include "cpu/simd.hpp"

#include <algorithm>
#include <memory>
#include <vector>

namespace bromwich::cpu {

/// Time is cut into tiles; the state at the start of each tile is kept. A call can begin at any tile whose past has not
/// changed. After `accumulate` and `carry`, several tiles can begin at once.
class ScanBlock {
 public:
  static constexpr Index tile = 128;  ///< rows; y and v of a block take 2 x 8 KB

  /// Modes 8b .. 8b + 7 of a convolution with `rows` rows.
  ScanBlock(const ModalRecurrence&, Index b, Index rows);

  /// See Convolution::start_from; b as in the constructor.
  void start_from(const RowMatrix& D, Index b);

  /// z, K x n values, is in the state before row 1 from now on.
  void begin_with(const double* z, Index K, Index n, Index b);

  /// Cost in multiply-adds per mode and row.
  static double cost(const ModalRecurrence&);

  /// Tile t covers the rows of v from begin(t) = 1 + t tile on; the last tile ends at row rows - 1.
  static Index tiles(Index rows) { return std::max<Index>(1, (rows - 1 + tile - 1) / tile); }
  static Index begin(Index t) { return 1 + t * tile; }

  /// Writes the `count` rows of tile t of v. `y` starts one row before the tile. With `keep`, stores the state at the
  /// start of the next tile.
  void apply(const Lanes* y, Lanes* v, Index t, Index count, bool keep);

  /// Sets the state at the start of tile `to` to 0.
  void clear(Index to) { std::fill_n(state(to), exponentials(), all(0)); }
  /// Advances the state of tile `to` over the rows of tile t. `y` starts one row before tile t.
  void accumulate(const Lanes* y, Index t, Index count, Index to);
  /// States of tiles from + length, from + 2 length, .. < end, from what `accumulate` stored there.
  void carry(Index from, Index length, Index end);

  std::size_t bytes() const;

 private:
  static constexpr Index group = 8;  ///< exponentials per register block; 8 states + 8 decays fit into 32 registers

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

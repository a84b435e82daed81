#pragma once
// Operations on rows of arrays, for backends whose memory is not that of the host: what a rank needs that has a slab of
// the time points (ranks/). Optional, all of them or none; without them whole arrays are copied to the host.

#include "plans.hpp"

#include <functional>
#include <memory>
#include <vector>

namespace bromwich {

/// A part of a state that is smaller than this, relative to its value in the beginning, is left out.
inline constexpr double forgotten = 1e-18;

/// A modal convolution of one rank, whose rows follow those of the ranks before. Its state z is that of
/// ModalRecurrence, K exponentials for each of n modes, and is kept in an array of one row, in an order of the backend.
class CarriedConvolution : public Convolution {
 public:
  CarriedConvolution(Index state_values, Index lasting_values) : state(state_values), lasting(lasting_values) {}

  /// to <- z after the last row of y, as if z were 0 in row 0; on the first rank z begins with y_0 and x0. `apply` to
  /// this y comes next.
  /// outliving <- the values of z that a whole slab does not forget; null where `lasting` is 0.
  virtual void leave(const Array& y, Array& to, Array* outliving) = 0;
  /// From now on `apply` begins with z in row 0: `left` by the rank before, and what ranks before it have left
  /// outliving (row r of `of_all`: rank r).
  virtual void begin(const Array& left, const Array* of_all) = 0;

  const Index state, lasting;  ///< values of a state, and of those that outlive a slab; 0 for two ranks
};

struct SlabOperations {
  /// Rows begin .. begin + count - 1 of `to` <- rows first, first + ratio, .. of `from`, zeros if that is null.
  std::function<void(const Array* from, Index first, Index ratio, Array& to, Index begin, Index count)> move_rows;
  std::function<void(const Array& from, Index first, Index count, double* to)> download_rows;
  std::function<void(const double* from, Array& to, Index first, Index count)> upload_rows;
  /// As Backend::interpolate, where row i of `fine` is row first + i of a grid with `ratio` times the steps of
  /// `coarse`.
  std::function<void(const Array& coarse, const Array* old, Index ratio, Index first, Array& fine)> interpolate_rows;
  /// Rank r has the rows ends[r] < j <= ends[r + 1], after a copy of row ends[r].
  std::function<std::unique_ptr<CarriedConvolution>(const ModalRecurrence&, const std::vector<Index>& ends, int rank)>
      carried_convolution;

  explicit operator bool() const { return bool(move_rows); }
};

}  // namespace bromwich

#pragma once
// Arrays of a backend that divides time, and the copies of their rows between ranks and to the host.

#include "../core/seam/backend.hpp"
#include "slabs.hpp"

#include <memory>
#include <utility>
#include <vector>

namespace bromwich {

/// All rows count; `local` has those of this rank. Row 0 of `local` is a copy of another rank's row where slabs.own()
/// is 1: it has values only where an operation has put them.
class SlabArray final : public Array {
 public:
  SlabArray(Slabs slabs_in, Index cols, std::unique_ptr<Array> local_in)
      : Array(slabs_in.steps + 1, cols), slabs(std::move(slabs_in)), local(std::move(local_in)) {}

  const Slabs slabs;
  const std::unique_ptr<Array> local;
};

inline const SlabArray& slab(const Array& array) { return static_cast<const SlabArray&>(array); }
/// The part of this rank. The copied row may be written in arrays that are otherwise read.
inline Array& local_part(const Array& array) { return *slab(array).local; }

/// The values of a local array on the host: where they lie, or a copy if that is elsewhere.
class HostRows {
 public:
  HostRows(Backend& local, Array& array);
  double* row(Index j) { return values_ + j * stride_; }
  /// Row j, j >= 1: the values at stage a, 0 or 1, of step j, where the array has two stages in each step.
  HostRows stage(int a) const { return {local_, array_, values_ + (a - 1) * cols_, cols_, 2 * stride_}; }
  /// Writes changed values into the array.
  void put();

 private:
  HostRows(Backend& local, Array& array, double* values, Index cols, Index stride)
      : local_(local), array_(array), values_(values), cols_(cols), stride_(stride) {}

  Backend& local_;
  Array& array_;
  RowMatrix copy_;
  double* values_;
  Index cols_, stride_;
};

/// A backend of this rank, and the other ranks. "Here": in a local array.
struct RankedBackend {
  Backend& local;
  Communicator& communicator;

  bool first() const { return communicator.rank() == 0; }
  bool last() const { return communicator.rank() + 1 == communicator.size(); }

  /// Rows of local arrays, to and from the host.
  RowMatrix rows_here(const Array&, Index first, Index count) const;
  void put_rows_here(const RowMatrix&, Array&, Index first) const;
  /// Communicator::shift and gather for local arrays, through the host where they have to.
  void shift(const std::vector<RowShift>&) const;
  void gather(const Array& values, Array& all) const;

  /// The row before the own ones, of one or more arrays of the same slabs, from the rank before.
  void copy_row_before(std::initializer_list<const Array*>) const;
  /// 0 in that row, so that sums and maxima over all rows here are those over the own ones.
  void clear_row_before(const Array&) const;
  /// All rows on all ranks.
  void download(const Array& from, RowMatrix& to) const;
  /// The first rows of an array, of which every rank has all values.
  void upload(const RowMatrix& from, Array& to) const;
  /// Every `ratio`-th row on all ranks: on the host, or in an array that all ranks have as a whole.
  RowMatrix every(const Array& from, Index ratio) const;
  void collect(const Array& from, Index ratio, Array& whole) const;

 private:
  void download_from_devices(const Array& from, RowMatrix& to) const;
};

}  // namespace bromwich

#pragma once
// Which time points belong to which rank. With J steps, rank r owns the rows (ends_r, ends_{r+1}] of a space-time
// array, a slab of time; row 0 belongs to rank 0.
//
// A point of time has the same owner on the grids with J, J/2, J/4, .. steps, so that values of a finer grid are where
// a coarser one needs them. For that the ends are multiples of the step of the coarsest of these grids that is divided.
// A grid is divided while a rank has Communicator::fewest_steps() of its steps in the mean. Every rank holds a shorter
// one as a whole, and computes it as the others do.

#include "../core/seam/communicator.hpp"

#include <vector>

namespace bromwich {

/// The rows that a rank holds of an array: its own, after a copy of the row before them, unless it is the first rank.
struct Slabs {
  std::vector<Index> ends;  ///< of the slabs, from 0 to J; empty: every rank holds all rows
  int rank = 0;
  Index steps = 0;  ///< J

  bool whole() const { return ends.empty(); }
  Index begin(int r) const { return ends[std::size_t(r)]; }
  Index count(int r) const { return ends[std::size_t(r) + 1] - begin(r); }
  /// The row of the array that is row 0 here.
  Index first() const { return whole() ? 0 : begin(rank); }
  /// Rows here.
  Index rows() const { return 1 + (whole() ? steps : count(rank)); }
  /// The first row here that this rank owns.
  Index own() const { return first() > 0 ? 1 : 0; }
  /// The first row here that is not before row `first` of the array; rows() if there is none.
  Index here(Index first_row) const;
  bool operator==(const Slabs& other) const { return ends == other.ends && steps == other.steps; }
};

/// Of arrays with `rows` rows. Ends are even where the number of steps is: an array with two stages in each step has
/// both in one slab.
Slabs slabs_of(Index rows, const Communicator&);

/// Whether both grids are divided, and the ends of slabs are the same points of them.
bool aligned(const Slabs& fine, const Slabs& coarse);

}  // namespace bromwich

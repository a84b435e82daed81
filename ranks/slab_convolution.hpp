#pragma once
// A convolution by recurrence (core/seam/recurrence.hpp) whose rows are divided among ranks. z is its state,
// v_j = W_0 y_j + w1 y_{j-1} + C z_{j-1} and z_j = E z_{j-1} + G y_j. Rank r owns the rows b_r < j <= b_{r+1}.
//
// 1. e_r, the state at the end of its slab if it had been 0 at the beginning; that of rank 0 has y_0 and x0 in it.
// 2. Messages: e_r, and y at b_{r+1} where w1 acts, to the next rank; what outlives a slab, to all.
// 3. z(b_r) = e_{r-1} + E^{b_r - b_{r-1}} e_{r-2} + ...
// 4. v of the slab: a convolution of this rank alone, which begins with z(b_r) where it has a state.
// 5. v_j += C E^{j-1-b_r} z(b_r) where it has none, as far as z is remembered.
//
// What is below `forgotten` (core/seam/slab_operations.hpp), relative to its value in the beginning, is left out in 1,
// 3 and 5. A backend with the operations on rows of that file does all of it in its own memory, and its plans begin
// with z.
//
// Bytes that all R ranks send for one convolution, with n columns and K exponentials a mode, P of which (of n K)
// outlive the shortest slab between two others:  8 ((R - 1) n (K + 1) + R (R - 1) P) in modes, P = 0 for R = 2. A dense
// state of m values: 8 ((R - 1) m + R (R - 1) P), P = m or 0. With two stages in each step, which drive one state, and
// by lag weights with K exponentials in common, as in modes.

#include "slab_array.hpp"

namespace bromwich {

/// v must have the slabs of y. Throws Error for a lag table without exponentials: sums over all lags do not end at a
/// slab.
std::unique_ptr<Convolution> make_slab_convolution(const RankedBackend&, WeightsRef, const Slabs&);
/// With two stages in each step. Null for a backend whose rows travel: four convolutions take its place.
std::unique_ptr<Convolution> make_slab_convolution(const RankedBackend&, const StageRecurrence&, const Slabs&);

}  // namespace bromwich

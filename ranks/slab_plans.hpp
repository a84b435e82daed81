#pragma once
// Plans that work row by row: the plan of each rank for its own rows, and a report for all of them. Plans for rows that
// every rank holds run on every rank and need no message.

#include "slab_array.hpp"

#include <memory>

namespace bromwich {

/// `local`: for arrays with slabs.rows() rows.
std::unique_ptr<RowTransform> make_slab_transform(std::unique_ptr<RowTransform> local, const Slabs&);
/// Queues, so that one report serves many batches (LcpBatch::at_once is false).
std::unique_ptr<LcpBatch> make_slab_lcp(const RankedBackend&, std::unique_ptr<LcpBatch> local, const Slabs&);
std::unique_ptr<Differences> make_slab_differences(const RankedBackend&, std::size_t slots);
/// Of rows that every rank computes: `whole` has all rows, of which it then keeps its own.
std::unique_ptr<Convolution> make_whole_convolution(const RankedBackend&, std::unique_ptr<Convolution> whole,
                                                    const Slabs&, Index cols);
/// Steps follow each other: every rank marches through all rows, of which it then keeps its own.
std::unique_ptr<March> make_slab_march(const RankedBackend&, const MarchProblem&, const Slabs&);

}  // namespace bromwich

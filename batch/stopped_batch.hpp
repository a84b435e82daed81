#pragma once
// Batches that a user may stop: the rows of scenes that were not reached are not written, which would take as long as
// the scenes before.

#include "batch.hpp"

namespace bromwich {

/// As solve_batch. Where `interrupted` of the options ended it, y, w and x have the rows of the first scenes alone, up
/// to the last one that is done, and w may be due.
BatchResult solve_batch_until_stopped(const Batch&, Backend&, const Options& = {}, const MakeBackend& another = {});

/// Adds the rows of all other scenes, NaN.
void add_missing_rows(BatchResult&);

/// Computes the rows of w that are due, on these threads: w = N x + M y + g. Calls functions of the user where scenes
/// have g of their own, on the calling thread.
void add_rows_of_w(const Batch&, const HostThreads&, BatchResult&);

}  // namespace bromwich

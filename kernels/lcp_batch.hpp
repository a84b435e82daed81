#pragma once
// What the batched complementarity solvers of this room share: one entry a row for what became of it, its reduction to
// a report, and the rows that are left to pivoting on the host.

#include "core/lcp/active_set_lcp.hpp"
#include "kernels/device.hpp"

#include <functional>

namespace bromwich::cuda {

/// One row of the batch. `sweeps` is negative where the row is unsolved.
struct RowOutcome {
  double change, magnitude;  ///< change NaN: not finite
  int sweeps;
};

/// The sum of all rows, reduced on the device.
struct BatchOutcome {
  double change, magnitude;
  long long sweeps;
  int unsolved, finite, settled;  ///< settled: rows before it changed by no more than the tolerance
};

class RowOutcomes {
 public:
  RowOutcomes(const Device&, Index rows);
  ~RowOutcomes();
  RowOutcomes(const RowOutcomes&) = delete;
  RowOutcomes& operator=(const RowOutcomes&) = delete;

  RowOutcome* data() { return rows_.data(); }
  std::size_t bytes() const { return rows_.bytes(); }

  /// Reduces rows first .. rows-1 and waits. What is unsolved goes to the solver row by row on the host.
  LcpReport report(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance,
                   const std::function<ActiveSetLcp&()>& solver);

 private:
  BatchOutcome reduce(Index first, Index rows, double settle_tolerance);
  void pivot(const Array& r, const Array& v, Array& y, Index first, ActiveSetLcp& solver, LcpReport& report);

  const Device& device_;
  Memory<RowOutcome> rows_;
  BatchOutcome* pinned_ = nullptr;  ///< on the host, written by the device
};

/// max_j ||min(y_j, w_j)||_inf / max(1, ||q_j||_inf) from one value a row, NaN where one of them is.
double largest(const Device&, const Memory<double>& per_row);

}  // namespace bromwich::cuda

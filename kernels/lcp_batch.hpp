#pragma once
// Shared by the batched complementarity solvers. A kernel counts the outcomes of its problems (lcp_outcome.cuh). Its
// last block writes the sums to the host, or they are collected later. Only unsolved problems are handled one by one,
// by pivoting on the host.

#include "core/lcp/active_set.hpp"
#include "kernels/device.hpp"

#include <functional>
#include <memory>
#include <vector>

namespace bromwich::cuda {

/// Arrays of a batch.
struct LcpArrays {
  const double *r, *v;  ///< v: null if the kernel computes it
  double* y;
  int stride;  ///< values between rows
};

/// Outcome of a batch. Doubles >= 0 are ordered like their bits, so maxima use integer atomics.
struct BatchOutcome {
  unsigned long long change, magnitude;  ///< bits of max |y_new - y_old| / max(1, |y_new|) and of max |y_new|
  unsigned long long sweeps;
  unsigned unsolved;
  unsigned settled;  ///< first row that changed by more than the tolerance
};

inline constexpr BatchOutcome empty_outcome{0, 0, 0, 0, ~0u};

/// Sums over all batches since the plan was made. Monotone.
struct BatchTotals {
  unsigned long long batches, magnitude;  ///< magnitude: bits of the largest
  unsigned long long sweeps, unsolved;
};

/// In pinned host memory; written by the device.
struct HandedOver {
  BatchOutcome sum;
  BatchTotals totals;
  unsigned batches;  ///< number of batches written so far; stored last
};

/// The totals of all plans of a device. They are fetched together, since several plans are usually collected in turn.
class TotalsBoard {
 public:
  struct Place {
    BatchTotals* on_device = nullptr;
    const BatchTotals* fetched = nullptr;
  };

  explicit TotalsBoard(const Device& device) : device_(device) {}
  ~TotalsBoard();
  TotalsBoard(const TotalsBoard&) = delete;
  TotalsBoard& operator=(const TotalsBoard&) = delete;

  Place take();  ///< zero on the device
  void give_back(const Place& place) { free_.push_back(place); }
  /// Waits for the device, then copies the totals of all plans to `fetched`.
  void fetch();

 private:
  static constexpr std::size_t of_page = 64;
  struct Page {
    Memory<BatchTotals> on_device;
    BatchTotals* fetched;
  };
  const Device& device_;
  std::vector<Page> pages_;
  std::vector<Place> free_;
  unsigned long fetched_ = ~0ul;  ///< Device::work at the last fetch
};

/// Where a kernel writes its outcome.
struct OutcomeTarget {
  int* rows;  ///< per row: Newton sweeps, negative if unsolved
  BatchTotals* totals;
  bool handed_over;    ///< false: only add to the totals; the members below are unused
  BatchOutcome* sum;   ///< empty before and after the batch
  unsigned* finished;  ///< finished blocks of this batch; 0 before and after
  unsigned* batches;   ///< batches written to the host so far
  HandedOver* host;
  double settle_tolerance;
};

class BatchOutcomes {
 public:
  /// `shift`: see Backend::shifted_lcp.
  BatchOutcomes(const Device&, Index rows, double shift = 0);
  ~BatchOutcomes() { board_->give_back(totals_); }
  BatchOutcomes(const BatchOutcomes&) = delete;
  BatchOutcomes& operator=(const BatchOutcomes&) = delete;

  /// Target of the next kernel, which solves this many problems. Only batches with `handed_over` have their own report.
  OutcomeTarget target(Index problems, double settle_tolerance, bool handed_over);
  std::size_t bytes() const { return rows_.bytes(); }

  /// Waits for the last batch, which covers rows first .. rows-1; call once per batch. Unsolved rows go to the solver
  /// one by one.
  LcpReport report(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance,
                   const std::function<ActiveSetLcp&()>& solver);
  /// Waits for all batches and sums up those since the last report; all must have had the same number of problems.
  /// `magnitude` is the largest since the plan was made.
  LcpReport collect();

 private:
  BatchOutcome wait();
  void pivot(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance, ActiveSetLcp& solver,
             LcpReport& report);

  const Device& device_;
  Memory<int> rows_;
  double shift_;
  Index problems_ = 0;
  Memory<BatchOutcome> sum_;
  std::shared_ptr<TotalsBoard> board_;
  TotalsBoard::Place totals_;
  Memory<unsigned> counters_;  ///< finished, batches
  Pinned<HandedOver> handed_over_;
  unsigned batches_ = 0;  ///< reported so far
  BatchTotals reported_{0, 0, 0, 0};
};

/// Largest of one value per row; NaN if one of them is.
double largest(const Device&, const Memory<double>& per_row);

}  // namespace bromwich::cuda

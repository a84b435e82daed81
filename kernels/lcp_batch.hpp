#pragma once
// What the batched complementarity solvers of this room share. A kernel counts what becomes of its problems on the way
// (lcp_outcome.cuh), and its last block hands the sums to the host (or they are collected later); only problems that it
// leaves are looked at one by one, by pivoting on the host.

#include "core/lcp/active_set.hpp"
#include "kernels/device.hpp"

#include <functional>
#include <memory>
#include <vector>

namespace bromwich::cuda {

/// What a batch works on.
struct LcpArrays {
  const double *r, *v;  ///< v: null where it comes from elsewhere
  double* y;
  int stride;  ///< from row to row
};

/// What became of a batch. Doubles >= 0 are ordered as their bits are, so that maxima are taken of the bits.
struct BatchOutcome {
  unsigned long long change, magnitude;  ///< bits of max |y_new - y_old| / max(1, |y_new|) and of max |y_new|
  unsigned long long sweeps;
  unsigned unsolved;
  unsigned settled;  ///< first row that changed by more than the tolerance
};

inline constexpr BatchOutcome empty_outcome{0, 0, 0, 0, ~0u};

/// Of all batches since the plan was made; they only grow.
struct BatchTotals {
  unsigned long long batches, magnitude;  ///< magnitude: bits of the largest
  unsigned long long sweeps, unsolved;
};

/// In memory of the host that the device writes.
struct HandedOver {
  BatchOutcome sum;
  BatchTotals totals;
  unsigned batches;  ///< that have been handed over; written last
};

/// The totals of all plans of a device, which come to the host together: many plans are asked for theirs in turn.
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
  /// Waits for the device. What was `fetched` is what the device has.
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
  unsigned long fetched_ = ~0ul;  ///< Device::work then
};

/// Where a kernel leaves its outcome.
struct OutcomeTarget {
  int* rows;  ///< per row: Newton sweeps, negative where the row is unsolved
  BatchTotals* totals;
  bool handed_over;    ///< false: it is only added to the totals, and what follows is not needed
  BatchOutcome* sum;   ///< empty before and after
  unsigned* finished;  ///< blocks of this batch that are done; 0 before and after
  unsigned* batches;   ///< that have been handed over
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

  /// For the kernel that is started next, over so many problems. Only one that is `handed_over` has a report of its
  /// own.
  OutcomeTarget target(Index problems, double settle_tolerance, bool handed_over);
  std::size_t bytes() const { return rows_.bytes(); }

  /// Waits for the batch over rows first .. rows-1 that was started last; one report a batch. What is unsolved goes to
  /// the solver row by row.
  LcpReport report(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance,
                   const std::function<ActiveSetLcp&()>& solver);
  /// Waits for all batches, and sums up those since the last report; they were over as many problems each. `magnitude`
  /// is the largest since the plan was made.
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
  unsigned batches_ = 0;  ///< reported
  BatchTotals reported_{0, 0, 0, 0};
};

/// The largest of one value a row, NaN where one of them is.
double largest(const Device&, const Memory<double>& per_row);

}  // namespace bromwich::cuda

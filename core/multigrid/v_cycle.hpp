#pragma once
// One V-cycle of the full approximation scheme of multigrid.hpp.

#include "time_levels.hpp"

#include <optional>
#include <utility>

namespace bromwich {

/// If all plans of all grids are asynchronous, a cycle never synchronises; failures are detected afterwards, and the
/// cycle is repeated synchronously.
class VCycle {
 public:
  /// With `notes_sweep`, y of the finest grid before its last sweep is kept in `old`.
  VCycle(Backend&, TimeLevels&, bool notes_sweep);

  /// For one solve. Counters and seconds are added to `result`.
  void begin(Result& result);
  /// Sets Result::convolutions and passes of the solve.
  void report_work() const;

  /// A cycle for the y and r of grid l.
  void run(std::size_t l);
  void solve_on(std::size_t l);  ///< likewise, with v = K y known
  void pose(std::size_t l);      ///< the problem of the coarser grid
  void ascend(std::size_t l);
  void sweep(TimeLevel&, SweepOrder);
  void apply(TimeLevel&);

  /// Waits for queued problems and adds their counts. Whether all were solved.
  bool collected();
  /// Whether batches are queued: nothing waits for one.
  bool queues() const { return queued_; }
  /// Queues from now on, if the plans of all grids are asynchronous.
  void queue_where_possible() { queued_ = all_queue(levels_); }
  void wait_for_each_batch() { queued_ = false; }

  /// Of a sweep, of a march, or as told by `stop`; nothing is computed after it.
  const std::optional<IterationOutcome>& failure() const { return failure_; }
  void stop(IterationOutcome outcome) { failure_ = std::move(outcome); }

 private:
  static bool all_queue(const TimeLevels&);

  /// Applications of K and passes, in values of the finest grid.
  struct Work {
    double convolutions = 0, passes = 0;
  };

  void sweep_coarsest();
  void descend(std::size_t l);
  void smooth(TimeLevel&);
  void march(TimeLevel&);
  void count(const LcpCount&);
  double share(const TimeLevel&) const;
  void replay(const std::function<void()>& recorded, const Work& work);
  void judge(const LcpReport&);
  void judge(const MarchReport&, Index steps);

  /// The two halves of a cycle on one grid, recorded; empty where operations are called one by one. On the coarsest
  /// grid `descend` is all.
  struct Recorded {
    std::function<void()> descend, ascend;
    Work of_descent = {}, of_ascent = {};
  };

  Backend& backend_;
  TimeLevels& levels_;
  bool queued_, notes_sweep_;
  std::optional<IterationOutcome> failure_;
  Result* result_ = nullptr;
  std::vector<Recorded> recorded_;
  Work work_;
};

}  // namespace bromwich

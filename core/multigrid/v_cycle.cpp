#include "core/multigrid/v_cycle.hpp"

#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"

#include <algorithm>
#include <utility>

namespace bromwich {

VCycle::VCycle(Backend& backend, TimeLevels& levels, bool notes_sweep)
    : backend_(backend), levels_(levels), queued_(all_queue(levels)), notes_sweep_(notes_sweep) {
  recorded_.resize(levels_.size());
  const std::size_t last = levels_.size() - 1;
  const auto can_be_recorded = [](const auto& level) {
    return level->kernel->recorded() && (!level->lcp || level->lcp->recorded);
  };
  const bool records = queued_ && std::all_of(levels_.grids.begin(), levels_.grids.end(), can_be_recorded);
  for (std::size_t l = 0; records && l <= last; ++l) {
    const Index values = levels_[l].y->rows() * levels_[l].y->cols();
    Recorded& recorded = recorded_[l];
    if (l < last) {
      recorded.descend = backend_.record(values, [this, l] { descend(l); });
      recorded.of_descent = std::exchange(work_, {});
      recorded.ascend = backend_.record(values, [this, l] { ascend(l); });
      recorded.of_ascent = std::exchange(work_, {});
    } else if (!levels_[l].march) {
      recorded.descend = backend_.record(values, [this] { sweep_coarsest(); });
      recorded.of_descent = std::exchange(work_, {});
    }
  }
}

void VCycle::begin(Result& result) {
  result_ = &result;
  failure_.reset();
  work_ = {};
  queue_where_possible();
}

void VCycle::report_work() const {
  result_->convolutions = work_.convolutions;
  result_->passes = work_.passes;
}

bool VCycle::all_queue(const TimeLevels& levels) {
  for (const auto& level : levels.grids)
    if (level->march ? level->march->at_once : level->lcp->at_once) return false;
  return true;
}

void VCycle::run(std::size_t l) {
  if (!levels_[l].march) apply(levels_[l]);
  solve_on(l);
}

void VCycle::solve_on(std::size_t l) {
  if (levels_[l].march) return march(levels_[l]);
  const Recorded& of = recorded_[l];
  if (l + 1 == levels_.size()) return queued_ && of.descend ? replay(of.descend, of.of_descent) : sweep_coarsest();
  const bool recorded = queued_ && of.descend && of.ascend;
  recorded ? replay(of.descend, of.of_descent) : descend(l);
  solve_on(levels_[l].coarse);
  recorded ? replay(of.ascend, of.of_ascent) : ascend(l);
  if (queued_ && l == 0) result_->iterations += levels_[l].sweeps + 1;
}

void VCycle::replay(const std::function<void()>& recorded, const Work& work) {
  recorded();
  work_.convolutions += work.convolutions;
  work_.passes += work.passes;
}

void VCycle::sweep_coarsest() {
  TimeLevel& coarsest = levels_[levels_.size() - 1];
  sweep(coarsest, {.count = coarsest.sweeps, .behind = coarsest.first_v != nullptr});
}

void VCycle::descend(std::size_t l) {
  TimeLevel& fine = levels_[l];
  if (fine.turns) fine.turns->begin();
  if (fine.sweeps > 0) sweep(fine, {.count = fine.sweeps, .behind = true});
  pose(l);
}

// r_c = R (r + K y) - K_c R y, and y_c = R y as the start. With P in place of M, P_f R y - P_c R y is added.
void VCycle::pose(std::size_t l) {
  TimeLevel &fine = levels_[l], &coarse = levels_[levels_[l].coarse];
  coarse.kernel->apply_injected(*fine.kernel, *fine.y, *coarse.y, *coarse.v);
  work_.convolutions += share(coarse);
  if (fine.lazy) backend_.inject(*coarse.v, *coarse.first_v);
  if (fine.staged)
    backend_.restrict_stages(*fine.r, *fine.v, *fine.y, *coarse.v, *coarse.r, *coarse.y, *coarse.old);
  else
    backend_.restrict_problem(*fine.r, *fine.v, *fine.y, *coarse.v, *coarse.r, *coarse.y, *coarse.old);
  if (!fine.matrix_change) return;
  fine.matrix_change->apply(*coarse.y, *fine.matrix_term, 0);
  backend_.add(*coarse.r, 1, *fine.matrix_term, *coarse.r);
}

// y <- y + I (y_c - R y), then a sweep.
void VCycle::ascend(std::size_t l) {
  TimeLevel &fine = levels_[l], &coarse = levels_[levels_[l].coarse];
  backend_.interpolate(*coarse.y, coarse.old.get(), *fine.y);
  if (notes_sweep_ && l == 0) backend_.inject(*fine.y, *fine.old);
  if (fine.lazy) backend_.interpolate(*coarse.v, coarse.first_v.get(), *fine.v);
  sweep(fine, {.count = 1, .before = !fine.lazy, .behind = fine.first_v != nullptr});
}

// One row of values of a grid, in units of the finest one.
double VCycle::share(const TimeLevel& level) const { return double(level.steps) / double(levels_[0].steps); }

// y <- SOL(M + D, r + K y - D y), with K y computed in between. If batches are not checked one by one, a batch may be
// merged with the adjacent operations.
void VCycle::sweep(TimeLevel& level, SweepOrder order) {
  if (queued_ && level.kernel->sweeps(*level.lcp)) {
    const int applied = order.count - 1 + int(order.before) + int(order.behind);
    work_.convolutions += share(level) * double(applied);
    work_.passes += share(level) * double(order.count * level.passes);
    return level.kernel->sweep(*level.lcp, *level.r, *level.y, *level.v, order);
  }
  for (int i = 0; i < order.count; ++i) {
    if (i > 0 || order.before) apply(level);
    smooth(level);
  }
  if (order.behind) apply(level);
}

void VCycle::apply(TimeLevel& level) {
  work_.convolutions += share(level);
  level.kernel->apply(*level.y, *level.v, 0);
}

// y <- SOL(M + D, r + K y - D y)
void VCycle::smooth(TimeLevel& level) {
  if (failure_) return;
  work_.passes += share(level) * double(level.passes);
  if (queued_) return level.lcp->submit(*level.r, *level.v, *level.y, 1, -1);
  Timer timer;
  const LcpReport report = level.lcp->solve(*level.r, *level.v, *level.y, 1);
  result_->seconds.lcp += timer.lap();
  if (&level == &levels_[0]) ++result_->iterations;
  judge(report);
}

void VCycle::march(TimeLevel& level) {
  if (failure_) return;
  if (queued_) return level.march->submit(*level.y, *level.v);
  const MarchReport report = level.march->run(*level.y, *level.v);
  result_->seconds.lcp += report.lcp_seconds;
  judge(report, level.steps);
}

// Whether all queued problems were solved. Adds their counts.
bool VCycle::collected() {
  bool solved = true;
  for (const auto& level : levels_.grids) {
    if (level->march && !level->march->at_once) {
      const MarchReport report = level->march->collect();
      count(report.count);
      solved = solved && report.stopped < 0;
    }
    if (level->lcp) {
      const LcpReport report = level->lcp->collect();
      count(report.count);
      solved = solved && report.count.unsolved == 0 && report.finite && report.magnitude < 1e100;
    }
  }
  return solved;
}

void VCycle::judge(const LcpReport& report) {
  count(report.count);
  if (!report.finite || !(report.magnitude < 1e100))
    failure_ = {Status::nonfinite, "the iterates grew beyond all bounds"};
  else if (report.count.unsolved > 0)
    failure_ = {Status::tolerance_not_met,
                text("%ld complementarity problems stayed unsolved; use method march", report.count.unsolved)};
}

void VCycle::judge(const MarchReport& report, Index steps) {
  count(report.count);
  if (report.interrupted)
    failure_ = {Status::interrupted, why_interrupted()};
  else if (!report.finite)
    failure_ = {Status::nonfinite, "the iterates grew beyond all bounds"};
  else if (report.stopped >= 0)
    failure_ = {Status::tolerance_not_met,
                text("a step of the coarsest grid, %ld steps, stayed unsolved; use method march", long(steps))};
}

void VCycle::count(const LcpCount& c) {
  result_->lcp.solved += c.solved;
  result_->lcp.newton += c.newton;
  result_->lcp.fallbacks += c.fallbacks;
  result_->lcp.unsolved = c.unsolved;
}

}  // namespace bromwich

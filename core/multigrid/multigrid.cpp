#include "core/multigrid/multigrid.hpp"

#include "core/base/first_touch.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/march/outcome.hpp"
#include "core/multigrid/cycle_watch.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr std::size_t grids_of_estimate = 3;
constexpr double least_ratio = 1.41421356;  ///< of differences: order 1/2
constexpr double slowly_smoothed =
    0.3;                              ///< above this smoothing factor the error of a nested start has high frequencies
constexpr int most_extra_sweeps = 3;  ///< after a cycle
constexpr double poor = 0.15;         ///< contraction of a cycle that may need an exact coarsest solution
/// Error seen by a coarse grid after the first cycle, relative to the correction. It is smaller than the contraction of
/// cycles, since the start is as smooth as the solution. If sweeps are known to smooth, the value is measured
/// (`bench multigrid` compares the estimates with the true errors); otherwise it is the contraction of cycles.
constexpr double assumed_contraction = 0.05, assumed_on_faces = 0.03, assumed_without_symbol = 0.2;

}  // namespace

Multigrid::Multigrid(Backend& backend, const Options& options, TimeLevels& levels)
    : backend_(backend),
      options_(&options),
      levels_(levels),
      useful_(options.tuning.algebraic_share > 0 && levels.estimates()),
      queued_(all_queue()),
      differences_(backend.differences(slots)) {
  recorded_.resize(levels_.size());
  const std::size_t last = levels_.size() - 1;
  for (std::size_t l = 0; queued_ && l <= last; ++l) {
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

void Multigrid::begin(const Options& options, Result& result) {
  options_ = &options;
  result_ = &result;
  failure_.reset();
  start_is_solved_ = false;
  work_ = {};
  queued_ = all_queue();
  for (const auto& level : levels_.grids) {  // values of an interrupted solve
    if (!nested_) break;
    if (level->lcp) level->lcp->collect();
    if (level->march) level->march->collect();
  }
}

bool Multigrid::all_queue() const {
  for (const auto& level : levels_.grids)
    if (level->march ? level->march->at_once : level->lcp->at_once) return false;
  return true;
}

void Multigrid::nest(const Vector& y0) {
  std::size_t last = levels_.size();
  for (std::size_t l = last; l-- > 0 && !failure_;) {
    if (left_out_of_start(l)) continue;
    if (options_->interrupted && options_->interrupted()) failure_ = {Status::interrupted, "stopped on request"};
    start_on(l, last, y0);
    if (l > 0 || levels_.size() == 1) nest_on(l);
    if (levels_[l].nested) backend_.inject(*levels_[l].y, *levels_[l].nested);
    last = l;
  }
  if (levels_.estimates()) {
    backend_.inject(*levels_[1].nested, ends_of(2));
    differences_->submit(quarter_step, ends_of(2), *levels_[2].nested);
  }
  y0_ = y0;
  nested_ = true;
}

// An array like `nested`, for values at the same times.
Array& Multigrid::ends_of(std::size_t l) { return levels_[l].ends ? *levels_[l].ends : *levels_[l].old; }

// Below the grids used for estimates, a cycle works with a ratio of four between the steps as well as with two.
bool Multigrid::left_out_of_start(std::size_t l) const {
  if (!levels_[l].starts) return true;
  if (l <= grids_of_estimate || l + 1 >= levels_.size() || (l - grids_of_estimate) % 2 == 0) return false;
  const TimeLevel &finer = levels_[l - 1], &coarser = levels_[l + 1];
  return finer.steps <= 4 * coarser.steps && finer.unseen <= slowly_smoothed;
}

// A cycle, or only sweeps: on the coarsest grid, which has no start, and where the error of the start is not smooth.
void Multigrid::nest_on(std::size_t l) {
  TimeLevel& level = levels_[l];
  const bool coarsest = l + 1 == levels_.size();
  if (coarsest && !level.march) {
    for (int visits = 0; visits < level.first_visits; ++visits) cycle(l);
  } else if (l >= grids_of_estimate && !coarsest && level.sweeps > 0 && level.unseen > slowly_smoothed) {
    sweep(level, {.count = level.sweeps + 1, .before = true});
  } else {
    for (int i = 0; i < (useful_ ? level.cycles_at_start : 1); ++i) cycle(l);
  }
}

// y of the coarser grid that was started last, or only y_0.
void Multigrid::start_on(std::size_t l, std::size_t last, const Vector& y0) {
  TimeLevel& level = levels_[l];
  if (nested_) backend_.add(*level.r, -1, *level.r, *level.y);  // arrays are zero when they are made
  if (last < levels_.size())
    backend_.interpolate(levels_[last].nested ? *levels_[last].nested : *levels_[last].y, nullptr, *levels_[l].y);
  else
    backend_.upload(y0.transpose(), *levels_[l].y);
}

IterationOutcome Multigrid::iterate() {
  const bool smoothing = levels_[0].sweeps > 0;  // by the symbol
  const bool on_face = levels_[0].passes > 1;    // relaxation in place of exact solutions
  const double assumed = !smoothing ? assumed_without_symbol : on_face ? assumed_on_faces : assumed_contraction;
  CycleWatch watch(options_->iteration_tolerance, useful_ ? assumed : INFINITY);
  while (!failure_) {
    if (options_->interrupted && options_->interrupted()) return {Status::interrupted, "stopped on request"};
    if (result_->iterations >= options_->max_iterations)
      return {Status::tolerance_not_met, text("%ld sweeps, the limit", long(result_->iterations))};
    if (useful_ && result_->cycles > 0) {
      const bool looked = watched([this] { look_for_correction(); });
      if (looked && !failure_ && useful(differences_->collect()[last_change], 0)) return {Status::solved, ""};
      if (looked) watched([this] { correct_finest(); });
    } else {
      watched([this] { whole_cycle(); });
    }
    if (failure_) break;
    const double change = differences_->collect()[last_change];
    ++result_->cycles;
    result_->history.push_back(change);
    if (options_->progress) options_->progress({result_->iterations, change});
    const auto outcome = watch.after(change);
    const double left = watch.left() + (useful_ ? unseen() : 0);
    result_->algebraic_error.reset();
    if (std::isfinite(left)) result_->algebraic_error = left;
    const bool solved = outcome && outcome->status == Status::solved;
    if (outcome && !(solved && useful_ && unseen() > options_->iteration_tolerance)) return *outcome;
    if (watch.contraction() > poor && march_from_now_on()) watch.restart();
    if (useful_ && useful(watch.left(), most_extra_sweeps)) return {Status::solved, ""};
  }
  return *failure_;
}

// The part of the error that the coarse grid does not represent.
double Multigrid::unseen() {
  const double f = levels_[0].unseen;
  return f / (1 - f) * differences_->collect()[last_sweep];
}

// Whether the algebraic error is a small enough part of the discretisation error. It consists of `seen`, the part on
// the coarse grid, and the rest, which further sweeps may reduce.
bool Multigrid::useful(double seen, int sweeps) {
  for (; std::isfinite(seen) && !failure_; --sweeps) {
    const double wanted = options_->tuning.algebraic_share * useful_error();
    result_->algebraic_error = seen + unseen();
    if (seen + unseen() <= wanted) return true;
    if (sweeps == 0 || !(unseen() * std::pow(levels_[0].unseen, sweeps) < wanted - seen)) return false;
    if (!watched([this] { one_more_sweep(); })) return false;  // `seen` belongs to an earlier y
  }
  return false;
}

bool Multigrid::march_from_now_on() {
  TimeLevel& coarsest = levels_[levels_.size() - 1];
  if (coarsest.march) return false;
  levels_.prepare_march();
  result_->bytes += coarsest.march->bytes();
  queued_ = queued_ && all_queue();
  return true;
}

// With y_2h and y_4h, the solutions on the next grids: |y_h - y_2h| / (q - 1), q = |y_2h - y_4h| / |y_h - y_2h|, at
// most 4 (order 2). Below order 1/2 the differences are not usable yet.
std::optional<double> Multigrid::discretisation_error() {
  if (!levels_.estimates()) return std::nullopt;
  const std::vector<double>& d = differences_->collect();
  const double last = d[half_step], before = d[quarter_step];
  const double ratio = last > 0 ? before / last : 4;
  if (!(ratio > least_ratio)) return std::nullopt;
  return last / (std::min(ratio, 4.0) - 1);
}

// The error with which the algebraic error is compared. If the grids do not converge yet, the estimate for the smallest
// accepted order.
double Multigrid::useful_error() {
  return discretisation_error().value_or(differences_->collect()[half_step] / (least_ratio - 1));
}

// Work on the finest grid, followed by the differences. If it, or the nested start, left a problem unsolved, a whole
// cycle is run instead, waiting for each batch; returns false then.
bool Multigrid::watched(const std::function<void()>& work) {
  work();
  if (!queued_ || collected()) {
    start_is_solved_ = true;
    return true;
  }
  queued_ = false;
  TimeLevel& finest = levels_[0];
  if (start_is_solved_ && !useful_) {
    backend_.inject(*finest.old, *finest.y);
  } else {
    levels_.respond();
    nest(y0_);
  }
  whole_cycle();
  start_is_solved_ = true;
  queued_ = !useful_ && all_queue();  // a complete restart has to continue in the same way
  return false;
}

void Multigrid::whole_cycle() {
  TimeLevel& finest = levels_[0];
  if (!useful_) backend_.inject(*finest.y, *finest.old);
  cycle(0);
  if (useful_)
    measure_correction();
  else
    differences_->submit(last_change, *finest.y, *finest.old);
  compare();
}

// A cycle in two parts, with sweeps before if one sweep smooths little. The first part changes y only by these sweeps.
void Multigrid::look_for_correction() {
  const TimeLevel& finest = levels_[0];
  for (int i = 0; i < finest.sweeps && finest.unseen > far_smoothed; ++i) one_more_sweep();
  apply(levels_[0]);
  pose(0);
  solve_on(finest.coarse);
  measure_correction();
}

void Multigrid::correct_finest() {
  ascend(0);
  if (queued_) ++result_->iterations;
  compare();
}

void Multigrid::measure_correction() {
  const TimeLevel& coarse = levels_[levels_[0].coarse];
  differences_->submit(last_change, *coarse.y, *coarse.old);
}

void Multigrid::one_more_sweep() {
  TimeLevel& finest = levels_[0];
  backend_.inject(*finest.y, *finest.old);
  sweep(finest, {.count = 1, .before = true});
  if (queued_) ++result_->iterations;
  compare();
}

// Compares y with its value before the last sweep, and y_2h with y.
void Multigrid::compare() {
  TimeLevel& finest = levels_[0];
  if (useful_) differences_->submit(last_sweep, *finest.y, *finest.old);
  if (!levels_.estimates()) return;
  backend_.inject(*finest.y, ends_of(1));
  differences_->submit(half_step, ends_of(1), *levels_[1].nested);
}

void Multigrid::cycle(std::size_t l) {
  if (!levels_[l].march) apply(levels_[l]);
  solve_on(l);
}

void Multigrid::solve_on(std::size_t l) {
  if (levels_[l].march) return march(levels_[l]);
  const Recorded& of = recorded_[l];
  if (l + 1 == levels_.size()) return queued_ && of.descend ? replay(of.descend, of.of_descent) : sweep_coarsest();
  const bool recorded = queued_ && of.descend && of.ascend;
  recorded ? replay(of.descend, of.of_descent) : descend(l);
  solve_on(levels_[l].coarse);
  recorded ? replay(of.ascend, of.of_ascent) : ascend(l);
  if (queued_ && l == 0) result_->iterations += levels_[l].sweeps + 1;
}

void Multigrid::replay(const std::function<void()>& recorded, const Work& work) {
  recorded();
  work_.convolutions += work.convolutions;
  work_.passes += work.passes;
}

void Multigrid::sweep_coarsest() {
  TimeLevel& coarsest = levels_[levels_.size() - 1];
  sweep(coarsest, {.count = coarsest.sweeps, .behind = coarsest.first_v != nullptr});
}

void Multigrid::descend(std::size_t l) {
  TimeLevel& fine = levels_[l];
  if (fine.turns) fine.turns->begin();
  if (fine.sweeps > 0) sweep(fine, {.count = fine.sweeps, .behind = true});
  pose(l);
}

// r_c = R (r + K y) - K_c R y, and y_c = R y as the start. With P in place of M, P_f R y - P_c R y is added.
void Multigrid::pose(std::size_t l) {
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
void Multigrid::ascend(std::size_t l) {
  TimeLevel &fine = levels_[l], &coarse = levels_[levels_[l].coarse];
  backend_.interpolate(*coarse.y, coarse.old.get(), *fine.y);
  if (useful_ && l == 0) backend_.inject(*fine.y, *fine.old);
  if (fine.lazy) backend_.interpolate(*coarse.v, coarse.first_v.get(), *fine.v);
  sweep(fine, {.count = 1, .before = !fine.lazy, .behind = fine.first_v != nullptr});
}

// One row of values of a grid, in units of the finest one.
double Multigrid::share(const TimeLevel& level) const { return double(level.steps) / double(levels_[0].steps); }

// y <- SOL(M + D, r + K y - D y), with K y computed in between. If batches are not checked one by one, a batch may be
// merged with the adjacent operations.
void Multigrid::sweep(TimeLevel& level, SweepOrder order) {
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

void Multigrid::apply(TimeLevel& level) {
  work_.convolutions += share(level);
  level.kernel->apply(*level.y, *level.v, 0);
}

// y <- SOL(M + D, r + K y - D y)
void Multigrid::smooth(TimeLevel& level) {
  if (failure_) return;
  work_.passes += share(level) * double(level.passes);
  if (queued_) return level.lcp->submit(*level.r, *level.v, *level.y, 1, -1);
  Timer timer;
  const LcpReport report = level.lcp->solve(*level.r, *level.v, *level.y, 1);
  result_->seconds.lcp += timer.lap();
  if (&level == &levels_[0]) ++result_->iterations;
  judge(report);
}

void Multigrid::march(TimeLevel& level) {
  if (failure_) return;
  if (queued_) return level.march->submit(*level.y, *level.v);
  const MarchReport report = level.march->run(*level.y, *level.v);
  result_->seconds.lcp += report.lcp_seconds;
  judge(report, level.steps);
}

// Whether all queued problems were solved. Adds their counts.
bool Multigrid::collected() {
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

void Multigrid::judge(const LcpReport& report) {
  count(report.count);
  if (!report.finite || !(report.magnitude < 1e100))
    failure_ = {Status::nonfinite, "the iterates grew beyond all bounds"};
  else if (report.count.unsolved > 0)
    failure_ = {Status::tolerance_not_met,
                text("%ld complementarity problems stayed unsolved; use method march", report.count.unsolved)};
}

void Multigrid::judge(const MarchReport& report, Index steps) {
  count(report.count);
  if (report.interrupted)
    failure_ = {Status::interrupted, "stopped on request"};
  else if (!report.finite)
    failure_ = {Status::nonfinite, "the iterates grew beyond all bounds"};
  else if (report.stopped >= 0)
    failure_ = {Status::tolerance_not_met,
                text("a step of the coarsest grid, %ld steps, stayed unsolved; use method march", long(steps))};
}

void Multigrid::count(const LcpCount& c) {
  result_->lcp.solved += c.solved;
  result_->lcp.newton += c.newton;
  result_->lcp.fallbacks += c.fallbacks;
  result_->lcp.unsolved = c.unsolved;
}

namespace {

void add_seconds(TimeLevels& levels, Result& result) {
  for (auto& level : levels.grids) {
    result.seconds.transform += level->kernel->transform_seconds;
    result.seconds.convolution += level->kernel->convolution_seconds;
  }
}

class PreparedMultigrid final : public PreparedMethod {
 public:
  PreparedMultigrid(TimeOperator& op, const Options& options, TimeLevels levels)
      : op_(op), p_(op.problem()), levels_(std::move(levels)), multigrid_(p_.backend, options, levels_), at_zero_(p_) {}

  void renew(const Changes& changes) override {
    at_zero_.renew();  // first: it waits for a device
    levels_.kernel_error = levels_.take_sources(changes);
  }

  void run(const Options& options, Result& result) override {
    Timer timer;
    result.kernel = levels_.description;
    result.kernel_error = levels_.kernel_error;
    result.bytes += host_bytes(p_) + op_.bytes_of_tables();
    for (auto& level : levels_.grids) {
      result.bytes += level->bytes();
      level->kernel->transform_seconds = level->kernel->convolution_seconds = 0;
    }
    multigrid_.begin(options, result);
    Vector y0;
    if (at_zero_.solve(result, y0) != Start::found) return;
    const IterationOutcome outcome = cycles(y0, result);
    multigrid_.report_work(result);
    result.seconds.sweeps = timer.lap();
    TimeLevel& finest = levels_[0];
    const ApplyKernel apply = [&](const Array& in, Array& out, Index first) { finest.kernel->apply(in, out, first); };
    const auto lcp =
        finest.lcp ? nullptr : p_.backend.lcp(p_.scene.M, p_.lcp_class, p_.J + 1);  // null: the grid is marched
    finish_iteration(p_, options, outcome, apply, finest.lcp ? *finest.lcp : *lcp, *finest.r, *finest.y, *finest.v,
                     result);
    if (result.status == Status::solved) result.error_estimate = multigrid_.discretisation_error();
    add_seconds(levels_, result);
  }

 private:
  // The host gets the memory of the result while a device works.
  IterationOutcome cycles(const Vector& y0, Result& result) {
    const bool works_beside = levels_[0].lcp && !levels_[0].lcp->at_once;
    std::optional<FirstTouch> touch;
    if (works_beside) {
      result.y.resize(p_.J + 1, p_.scene.constraints());
      touch.emplace(result.y.data(), std::size_t(result.y.size()));
    }
    multigrid_.nest(y0);
    return multigrid_.iterate();
  }

  TimeOperator& op_;
  const DiscreteProblem& p_;
  TimeLevels levels_;
  Multigrid multigrid_;
  ProblemAtZero at_zero_;
};

}  // namespace

std::unique_ptr<PreparedMethod> prepare_multigrid(TimeOperator& op, const Options& options) {
  TimeLevels levels = time_levels(op, options);
  if (levels.size() == 0) return nullptr;
  return std::make_unique<PreparedMultigrid>(op, options, std::move(levels));
}

}  // namespace bromwich

#include "core/multigrid/multigrid.hpp"

#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/multigrid/cycle_watch.hpp"

#include <algorithm>
#include <cmath>

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
      cycle_(backend, levels, useful_),
      differences_(backend.differences(slots)) {}

void Multigrid::begin(const Options& options, Result& result) {
  options_ = &options;
  result_ = &result;
  cycle_.begin(result);
  start_is_solved_ = false;
  for (const auto& level : levels_.grids) {  // values of an interrupted solve
    if (!nested_) break;
    if (level->lcp) level->lcp->collect();
    if (level->march) level->march->collect();
  }
}

void Multigrid::nest(const Vector& y0) {
  std::size_t last = levels_.size();
  for (std::size_t l = last; l-- > 0 && !cycle_.failure();) {
    if (left_out_of_start(l)) continue;
    if (options_->interrupted && options_->interrupted()) cycle_.stop({Status::interrupted, why_interrupted()});
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
    for (int visits = 0; visits < level.first_visits; ++visits) cycle_.run(l);
  } else if (l >= grids_of_estimate && !coarsest && level.sweeps > 0 && level.unseen > slowly_smoothed) {
    cycle_.sweep(level, {.count = level.sweeps + 1, .before = true});
  } else {
    for (int i = 0; i < (useful_ ? level.cycles_at_start : 1); ++i) cycle_.run(l);
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
  while (!cycle_.failure()) {
    if (options_->interrupted && options_->interrupted()) return {Status::interrupted, why_interrupted()};
    if (result_->iterations >= options_->max_iterations)
      return {Status::tolerance_not_met, text("%ld sweeps, the limit", long(result_->iterations))};
    if (useful_ && result_->cycles > 0) {
      const bool looked = watched([this] { look_for_correction(); });
      if (looked && !cycle_.failure() && useful(differences_->collect()[last_change], 0)) return {Status::solved, ""};
      if (looked) watched([this] { correct_finest(); });
    } else {
      watched([this] { whole_cycle(); });
    }
    if (cycle_.failure()) break;
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
  return *cycle_.failure();
}

// The part of the error that the coarse grid does not represent.
double Multigrid::unseen() {
  const double f = levels_[0].unseen;
  return f / (1 - f) * differences_->collect()[last_sweep];
}

// Whether the algebraic error is a small enough part of the discretisation error. It consists of `seen`, the part on
// the coarse grid, and the rest, which further sweeps may reduce.
bool Multigrid::useful(double seen, int sweeps) {
  for (; std::isfinite(seen) && !cycle_.failure(); --sweeps) {
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
  if (cycle_.queues()) cycle_.queue_where_possible();
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
  if (!cycle_.queues() || cycle_.collected()) {
    start_is_solved_ = true;
    return true;
  }
  cycle_.wait_for_each_batch();
  TimeLevel& finest = levels_[0];
  if (start_is_solved_ && !useful_) {
    backend_.inject(*finest.old, *finest.y);
  } else {
    levels_.respond();
    nest(y0_);
  }
  whole_cycle();
  start_is_solved_ = true;
  if (!useful_) cycle_.queue_where_possible();  // a complete restart has to continue in the same way
  return false;
}

void Multigrid::whole_cycle() {
  TimeLevel& finest = levels_[0];
  if (!useful_) backend_.inject(*finest.y, *finest.old);
  cycle_.run(0);
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
  cycle_.apply(levels_[0]);
  cycle_.pose(0);
  cycle_.solve_on(finest.coarse);
  measure_correction();
}

void Multigrid::correct_finest() {
  cycle_.ascend(0);
  if (cycle_.queues()) ++result_->iterations;
  compare();
}

void Multigrid::measure_correction() {
  const TimeLevel& coarse = levels_[levels_[0].coarse];
  differences_->submit(last_change, *coarse.y, *coarse.old);
}

void Multigrid::one_more_sweep() {
  TimeLevel& finest = levels_[0];
  backend_.inject(*finest.y, *finest.old);
  cycle_.sweep(finest, {.count = 1, .before = true});
  if (cycle_.queues()) ++result_->iterations;
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

}  // namespace bromwich

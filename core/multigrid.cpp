#include "core/multigrid.hpp"

#include "core/march_outcome.hpp"
#include "core/text.hpp"
#include "core/timer.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index most_cycles = 40;
constexpr double slow = 0.5;              ///< contraction of a cycle that does not pay
constexpr double rounding_level = 1e-10;  ///< changes that rounding may keep up

// Watches the changes of y from cycle to cycle and says when they are over.
class Watch {
 public:
  explicit Watch(double tolerance) : tolerance_(tolerance) {}

  // With contraction c what is left after a change is at most change c / (1 - c); c is the larger of the last two,
  // since the first is flattered by the error of the start.
  std::optional<IterationOutcome> after(double change) {
    if (!std::isfinite(change)) return IterationOutcome{Status::nonfinite, "the iterates grew beyond all bounds"};
    const double contraction = change / change_, worst = std::max(contraction, contraction_);
    slow_ = cycles_ > 0 && contraction > slow ? slow_ + 1 : 0;
    change_ = change;
    contraction_ = contraction;
    if (change <= tolerance_ || (worst < slow && change * worst / (1 - worst) <= tolerance_) ||
        (slow_ > 0 && change <= rounding_level))
      return IterationOutcome{Status::solved, ""};
    if (slow_ >= 2 || ++cycles_ >= most_cycles)
      return IterationOutcome{Status::tolerance_not_met,
                              text("the cycles do not contract: change %.2e in the last, %.2f of that before; use "
                                   "method march or more steps",
                                   change, contraction)};
    return std::nullopt;
  }

 private:
  double tolerance_, change_ = 0, contraction_ = INFINITY;
  Index slow_ = 0, cycles_ = 0;
};

}  // namespace

std::vector<RowMatrix> Multigrid::nest(const Vector& y0) {
  const std::size_t last = levels_.size() - 1;
  RowMatrix start = RowMatrix::Zero(levels_[last].steps + 1, y0.size());
  start.row(0) = y0.transpose();
  backend_.upload(start, *levels_[last].y);
  march(levels_[last]);
  std::vector<RowMatrix> solutions;
  for (std::size_t l = last; l-- > 0 && !failure_;) {
    if (l < 2) solutions.insert(solutions.begin(), download(*levels_[l + 1].y));
    backend_.interpolate(*levels_[l + 1].y, nullptr, *levels_[l].y);
    if (l > 0) cycle(l);
  }
  return solutions;
}

IterationOutcome Multigrid::iterate() {
  TimeLevel& finest = levels_[0];
  Watch watch(options_.iteration_tolerance);
  while (!failure_) {
    if (options_.interrupted && options_.interrupted()) return {Status::interrupted, "stopped on request"};
    if (result_.iterations >= options_.max_iterations)
      return {Status::tolerance_not_met, text("%ld sweeps, the limit", long(result_.iterations))};
    backend_.inject(*finest.y, *finest.old);
    cycle(0);
    if (failure_) break;
    const double change = backend_.difference(*finest.y, *finest.old);
    ++result_.cycles;
    result_.history.push_back(change);
    if (options_.progress) options_.progress({result_.iterations, change});
    if (const auto outcome = watch.after(change)) return *outcome;
  }
  return *failure_;
}

void Multigrid::cycle(std::size_t l) {
  if (l + 1 == levels_.size()) return march(levels_[l]);
  TimeLevel &fine = levels_[l], &coarse = levels_[l + 1];
  for (int i = 0; i < fine.sweeps; ++i) smooth(fine);
  pose_coarse_problem(fine, coarse);
  cycle(l + 1);
  backend_.interpolate(*coarse.y, coarse.old.get(), *fine.y);
  smooth(fine);
}

// r_c = R (r + K y) - K_c R y, and y_c = R y to begin with.
void Multigrid::pose_coarse_problem(TimeLevel& fine, TimeLevel& coarse) {
  fine.kernel->apply(*fine.y, *fine.v, 0);
  backend_.add(*fine.r, 1, *fine.v, *fine.v);
  backend_.inject(*fine.v, *coarse.r);
  backend_.inject(*fine.y, *coarse.y);
  backend_.inject(*coarse.y, *coarse.old);
  coarse.kernel->apply(*coarse.y, *coarse.v, 0);
  backend_.add(*coarse.r, -1, *coarse.v, *coarse.r);
}

// y <- SOL(M + D, r + K y - D y)
void Multigrid::smooth(TimeLevel& level) {
  if (failure_) return;
  level.kernel->apply(*level.y, *level.v, 0);
  if (level.shift != 0) backend_.add(*level.v, -level.shift, *level.y, *level.v);
  Timer timer;
  const LcpReport report = level.lcp->solve(*level.r, *level.v, *level.y, 1, -1);
  result_.seconds.lcp += timer.lap();
  count(report.count);
  if (&level == &levels_[0]) ++result_.iterations;
  if (!report.finite || !(report.magnitude < 1e100))
    failure_ = {Status::nonfinite, "the iterates grew beyond all bounds"};
  else if (report.count.unsolved > 0)
    failure_ = {Status::tolerance_not_met,
                text("%ld complementarity problems stayed unsolved; use method march", report.count.unsolved)};
}

void Multigrid::march(TimeLevel& level) {
  if (failure_) return;
  const MarchReport report = level.march->run(*level.y, *level.v);
  count(report.count);
  result_.seconds.lcp += report.lcp_seconds;
  if (report.interrupted)
    failure_ = {Status::interrupted, "stopped on request"};
  else if (!report.finite)
    failure_ = {Status::nonfinite, "the iterates grew beyond all bounds"};
  else if (report.stopped >= 0)
    failure_ = {Status::tolerance_not_met,
                text("a step of the coarsest grid, %ld steps, stayed unsolved; use method march", long(level.steps))};
}

void Multigrid::count(const LcpCount& c) {
  result_.lcp.solved += c.solved;
  result_.lcp.newton += c.newton;
  result_.lcp.fallbacks += c.fallbacks;
  result_.lcp.unsolved = c.unsolved;
}

RowMatrix Multigrid::download(const Array& array) {
  RowMatrix values;
  backend_.download(array, values);
  return values;
}

namespace {

// Largest difference at the points of the coarser grid.
double distance(const RowMatrix& fine, const RowMatrix& coarse) {
  double largest = 0;
  for (Index i = 0; i < coarse.rows(); ++i)
    largest = std::max(largest, (fine.row(2 * i) - coarse.row(i)).cwiseAbs().maxCoeff());
  return largest;
}

// With y_2h and y_4h, the solutions on the next grids: |y_h - y_2h| / (q - 1), q = |y_2h - y_4h| / |y_h - y_2h|; 4
// where the order is 2, and at most that. Below an order of 1/2 the differences say nothing yet.
std::optional<double> estimated_error(const RowMatrix& y, const std::vector<RowMatrix>& coarser) {
  if (coarser.size() < 2) return std::nullopt;
  const double last = distance(y, coarser[0]), before = distance(coarser[0], coarser[1]);
  const double ratio = last > 0 ? before / last : 4;
  if (!(ratio > std::sqrt(2.0))) return std::nullopt;
  return last / (std::min(ratio, 4.0) - 1);
}

void add_seconds(TimeLevels& levels, Result& result) {
  for (auto& level : levels.grids) {
    result.seconds.transform += level->kernel->transform_seconds;
    result.seconds.convolution += level->kernel->convolution_seconds;
  }
}

}  // namespace

bool solve_by_multigrid(const DiscreteProblem& p, const SparseKernel* kernel, const Options& options, Result& result) {
  Timer timer;
  TimeLevels levels = time_levels(p, kernel, options);
  if (levels.size() == 0) {
    result.seconds.setup += timer.lap();
    return false;
  }
  result.kernel = levels.description;
  result.kernel_error = levels.kernel_error;
  result.bytes += host_bytes(p) + (kernel ? kernel->bytes : 0);
  for (auto& level : levels.grids) {
    result.bytes += level->bytes();
    level->kernel->transform_seconds = level->kernel->convolution_seconds = 0;
  }
  result.seconds.setup += timer.lap();

  if (solve_at_zero(p, result) != Start::found) return true;
  Multigrid multigrid(p.backend, options, levels, result);
  const std::vector<RowMatrix> coarser = multigrid.nest(result.y.row(0).transpose());
  const IterationOutcome outcome = multigrid.iterate();
  result.seconds.sweeps = timer.lap();
  TimeLevel& finest = levels[0];
  const auto lcp = p.backend.lcp(p.scene.M, p.lcp_class, p.J + 1);  // without the shift
  const ApplyKernel apply = [&](const Array& in, Array& out, Index first) { finest.kernel->apply(in, out, first); };
  finish_iteration(p, options, outcome, apply, *lcp, *finest.r, *finest.y, *finest.v, result);
  if (result.status == Status::solved) result.error_estimate = estimated_error(result.y, coarser);
  add_seconds(levels, result);
  return true;
}

}  // namespace bromwich

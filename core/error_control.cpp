#include "core/error_control.hpp"

#include "core/convergence.hpp"
#include "core/error.hpp"
#include "core/text.hpp"
#include "core/timer.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double accepted = 0.8;              ///< of the tolerance
constexpr double algebraic_share = 0.1;       ///< of a grid's discretisation error, that cycles may leave
constexpr Index fewest_steps = 16;            ///< of a first grid of our choice
constexpr Index most_steps = Index(1) << 20;  ///< of a further grid
constexpr Index patience = 4;                 ///< times the scene's steps: below, a failure is put down to the grid
constexpr double out_of_reach = 4;            ///< times most_steps, predicted with the full order

Index first_grid(const Scene& scene, const Options& options) {
  Index J = options.steps > 0 ? options.steps : scene.default_steps;
  while (options.steps == 0 && J % 2 == 0 && J / 2 >= fewest_steps) J /= 2;
  return J;
}

// y for half the step, linear between the rows there are.
RowMatrix refined(const RowMatrix& y) {
  RowMatrix fine(2 * y.rows() - 1, y.cols());
  for (Index j = 0; j < y.rows(); ++j) fine.row(2 * j) = y.row(j);
  for (Index j = 0; j + 1 < y.rows(); ++j) fine.row(2 * j + 1) = (y.row(j) + y.row(j + 1)) / 2;
  return fine;
}

class Refinement {
 public:
  Refinement(const Scene& scene, Backend& backend, const Options& options)
      : scene_(scene), backend_(backend), options_(options), expected_(std::max(options.steps, scene.default_steps)) {}

  Result run() {
    for (Index J = first_grid(scene_, options_);; J *= 2) {
      if (!grids_.empty() && J > most_steps)
        return ended(text("more than %ld steps would be needed", long(most_steps)));
      Result next;
      try {
        next = solve_on(J);
      } catch (const Error& error) {  // the first grid says what is wrong with the input
        if (grids_.empty()) throw;
        return ended(std::string("the next grid is refused: ") + error.what());
      }
      grids_.push_back(J);
      if (next.status != Status::solved) {
        if (is_final(next)) return ended_by(next);
        failed_ = std::move(next);
        convergence_.reset();
        continue;
      }
      take(next);
      std::optional<std::string> end = verdict();
      if (end && end->empty() && convergence_->wants_check()) {
        check();
        end = verdict();
      }
      if (end) return ended(*end);
    }
  }

 private:
  Result solve_on(Index J) {
    Options one = options_;
    one.tolerance = 0;
    one.steps = J;
    one.look_inside_every_step = true;
    one.algebraic_share = algebraic_share;
    RowMatrix start;
    if (solved_ && solved_->continuous && 2 * solved_->steps == J) {
      start = refined(solved_->y);
      one.first_iterate = &start;
    } else {
      one.first_iterate = grids_.empty() ? options_.first_iterate : nullptr;
    }
    Result result = solve(scene_, backend_, one);
    spent_ = spent_ + result.seconds;
    return result;
  }

  // Whether a grid that was not solved ends the search. On a coarse grid anything may go wrong.
  bool is_final(const Result& next) const {
    if (next.status == Status::interrupted || next.infeasible_at == 0.0) return true;
    if (next.status == Status::infeasible && failed_ && failed_->status == Status::infeasible &&
        std::abs(*failed_->infeasible_at - *next.infeasible_at) <= 2 * scene_.T / double(failed_->steps))
      return next.steps >= expected_;
    return next.steps >= (next.status == Status::unsupported ? 1 : patience) * expected_;
  }

  void take(Result& next) {
    const bool same = solved_ && solved_->method == next.method && solved_->continuous == next.continuous &&
                      2 * solved_->steps == next.steps;
    if (!same || !convergence_) convergence_.emplace(scene_, next);
    if (same) convergence_->add(*solved_, next, next.steps >= expected_);
    solved_ = std::move(next);
    failed_.reset();
    unchecked_ = false;
    estimate();
  }

  // Jumps that stay in their steps when these are halved do not on a grid of 3/4 of the steps. Where that cannot be
  // compared the estimate is not relied on.
  void check() {
    unchecked_ = true;
    const Index J = solved_->steps;
    if (J % 4 != 0) return;
    const Result other = solve_on(J / 4 * 3);
    grids_.insert(grids_.end() - 1, other.steps);
    if (other.status != Status::solved || other.method != solved_->method || other.continuous != solved_->continuous)
      return;
    convergence_->check(other, *solved_);
    unchecked_ = false;
    estimate();
  }

  void estimate() {
    ErrorEstimate e;
    e.tolerance = options_.tolerance;
    const double largest = solved_->y.bottomRows(solved_->steps).cwiseAbs().maxCoeff(), size = std::max(1.0, largest);
    e.kernel = solved_->kernel_error * largest / size;
    e.iteration = solved_->algebraic_error.value_or(iteration_error(solved_->history));
    e.of_integral = convergence_->of_integral();
    e.rounding = (e.of_integral ? solved_->rounding * largest : solved_->rounding_of_y) / size;
    e.discretisation = convergence_->error();
    e.order = convergence_->controlled().order();
    if (controls_states()) e.states = convergence_->error_of_x() + solved_->rounding;
    e.grids = grids_;
    solved_->errors = e;
    solved_->error_estimate.reset();
    if (!std::isnan(e.discretisation)) solved_->error_estimate = std::max(e.total(), controls_states() ? e.states : 0);
  }

  bool controls_states() const { return options_.control_states && solved_->x.cols() > 0; }

  // Empty: the tolerance is met. Nothing: go on. Otherwise why it will not be met.
  std::optional<std::string> verdict() const {
    const ErrorEstimate& e = *solved_->errors;
    const GridDifferences& y = convergence_->controlled();
    const double goal = accepted * options_.tolerance;
    const std::size_t window = e.of_integral ? 3 : 2;
    const bool judged = convergence_->can_be_judged() && !unchecked_ && solved_->error_estimate &&
                        !(controls_states() && convergence_->states().changes_abruptly());
    if (judged && *solved_->error_estimate <= goal) return "";
    if (solved_->steps < patience * expected_) return std::nullopt;
    const double other = e.total() - (std::isnan(e.discretisation) ? 0 : e.discretisation);
    if (other > goal)
      return text(
          "the weights of the kernel are known to %.1e, the iteration leaves %.1e and rounding %.1e: no grid "
          "does better",
          e.kernel, e.iteration, e.rounding);
    if (unchecked_)
      return text(
          "with %ld steps, whose points jumps of y do not share, another method is taken or none solves the scene",
          long(solved_->steps / 4 * 3));
    if (!y.confirmed()) return std::nullopt;
    if (y.stalled(window) && e.total() > goal)
      return text("halving the step does not bring the solutions together any more: %s still moves by %.1e",
                  e.of_integral ? "the mean of y" : "y", y.last());
    if (controls_states() && convergence_->states().stalled(window) && e.states > goal)
      return text("halving the step does not bring the states together any more: they still move by %.1e",
                  convergence_->states().last());
    const double needed = double(solved_->steps) * std::exp2(y.halvings_to(goal - other));
    if (needed > out_of_reach * double(most_steps)) return text("about %.0e steps would be needed", needed);
    return std::nullopt;
  }

  // What a coarser grid has found stays, except where the scene has no solution.
  Result ended_by(Result& next) {
    if (!solved_ || next.status == Status::infeasible) return failed(next);
    const Status why = next.status == Status::interrupted ? next.status : Status::tolerance_not_met;
    return ended(text("with %ld steps: ", long(next.steps)) + next.reason, why);
  }

  Result failed(Result& next) {
    next.errors.emplace().grids = grids_;
    next.errors->tolerance = options_.tolerance;
    next.seconds = spent_;
    return std::move(next);
  }

  Result ended(const std::string& reason, Status status = Status::tolerance_not_met) {
    if (!solved_) return failed(*failed_);
    Result& result = *solved_;
    result.errors->grids = grids_;
    result.seconds = spent_;
    if (reason.empty()) return std::move(result);
    result.status = status;
    result.reason = result.error_estimate
                        ? text("the error is about %.1e with %ld steps, not %.1e: ", *result.error_estimate,
                               long(result.steps), options_.tolerance) +
                              reason
                        : "the error could not be estimated: " + reason;
    return std::move(result);
  }

  const Scene& scene_;
  Backend& backend_;
  const Options& options_;
  const Index expected_;  ///< steps with which the scene is meant to be solved
  std::vector<Index> grids_;
  std::optional<Result> solved_, failed_;   ///< the last grid of each kind; failed_ only if it is the last of all
  std::optional<Convergence> convergence_;  ///< of the grids that the method of solved_ has solved
  bool unchecked_ = false;                  ///< the grid that checks the last one could not
  Seconds spent_;
};

}  // namespace

double iteration_error(const std::vector<double>& history) {
  const std::size_t n = history.size();
  if (n == 0 || history.back() == 0) return 0;
  constexpr double slowest = 0.99;
  const std::size_t sweeps = std::min<std::size_t>(4, n - 1);
  const double c =
      sweeps == 0 ? slowest : std::min(slowest, std::pow(history[n - 1] / history[n - 1 - sweeps], 1 / double(sweeps)));
  return history.back() * c / (1 - c);
}

Result solve_to_tolerance(const Scene& scene, Backend& backend, const Options& options) {
  return Refinement(scene, backend, options).run();
}

}  // namespace bromwich

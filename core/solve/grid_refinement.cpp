#include "core/solve/grid_refinement.hpp"

#include "core/adapted/radau_steps.hpp"
#include "core/base/error.hpp"
#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/solve/adapted_march.hpp"
#include "core/solve/beside_march.hpp"
#include "core/solve/cost.hpp"
#include "core/solve/methods.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double algebraic_share = 0.1;       ///< of a grid's discretisation error, that cycles may leave
constexpr int most_repeats = 3;               ///< of a grid, for that
constexpr double least_change = 1e-13;        ///< of y, at which sweeps end: rounding
constexpr Index fewest_steps = 16;            ///< of a first grid of our choice
constexpr double most_growth = 1e3;           ///< of perturbations, above which all grids measure their rounding
constexpr Index patience_with_failures = 16;  ///< times the scene's steps: below, a failure is put down to the grid

// As many steps as breakpoints, at least: with fewer, grids may look at all periods of a source in the same phases.
Index first_grid(const Scene& scene, const Options& options) {
  const Index jumps = std::min(Index(scene.breakpoints.size()), options.max_steps / 2);
  Index J = steps_of(scene, options);
  while (options.steps == 0 && J % 2 == 0 && J / 2 >= std::max(fewest_steps, jumps)) J /= 2;
  while (J < jumps) J *= 2;
  return J;
}

// y for half the step, linear between the rows there are.
RowMatrix refined(const RowMatrix& y) {
  RowMatrix fine(2 * y.rows() - 1, y.cols());
  for (Index j = 0; j < y.rows(); ++j) fine.row(2 * j) = y.row(j);
  for (Index j = 0; j + 1 < y.rows(); ++j) fine.row(2 * j + 1) = (y.row(j) + y.row(j + 1)) / 2;
  return fine;
}

}  // namespace

GridRefinement::GridRefinement(const Scene& scene, Backend& backend, const InnerOptions& options, bool measures)
    : scene_(scene),
      backend_(backend),
      options_(options),
      goal_(options),
      sizes_(sizes_for(scene, options)),
      expected_(std::max({options.steps, scene.steps(), Index(scene.breakpoints.size())})),
      next_(first_grid(scene, options)),
      tried_reference_(!measures),
      share_(algebraic_share),
      last_change_(options.iteration_tolerance) {}

Result GridRefinement::run() {
  for (;;)
    if (std::optional<Result> result = advance()) return std::move(*result);
}

std::optional<Result> GridRefinement::advance(double most_operations) {
  std::optional<Result> result;
  try {
    result = next_grid(most_operations);
  } catch (const Interrupted&) {  // between grids: the last one that was solved is there
    if (!solved_) throw;
    if (!solved_->errors) solved_->errors.emplace().tolerance = goal_.smallest();
    result = ended(why_interrupted(), Status::interrupted);
  }
  if (result && !options_.trace) result->trace.resize(0, 0);
  return result;
}

std::optional<Result> GridRefinement::next_grid(double most_operations) {
  const Index J = std::exchange(next_, 2 * next_);
  if (const std::string budget = grids_.empty() ? "" : spent(J); !budget.empty()) return ended(budget);
  Result next;
  try {
    next = solve_on(J);
  } catch (const Error& error) {  // the first grid says what is wrong with the input
    if (error.kind() == ErrorKind::device || error.kind() == ErrorKind::internal) throw;
    if (grids_.empty()) throw;
    return ended(std::string("the next grid is refused: ") + error.what());
  }
  const bool resolved = J >= expected_ && share_ > 0;
  if (resolved && next.status == Status::tolerance_not_met && next.algebraic_error.value_or(0) > 0) {
    share_ = 0;  // its cycles may have ended too early
    next = solve_on(J);
  }
  add_grid(J);
  if (next.status != Status::solved) {
    note(options_.log, LogLevel::info, "%s on %ld steps: %s, %s", to_string(next.method), long(J),
         to_string(next.status), next.reason.c_str());
    if (is_final(next)) return ended_by(next);
    failed_ = std::move(next);
    convergence_.reset();
    return std::nullopt;
  }
  take(next);
  if (const std::optional<std::string> end = judgement()) return ended(*end);
  return on_tree(most_operations);
}

// The verdict, with the checks that it asks for.
std::optional<std::string> GridRefinement::judgement() {
  if (!reference_) iterate_on();
  std::optional<std::string> end = verdict();
  if (end && end->empty() && !reference_ && !holds_inside()) end = std::nullopt;
  const bool done = end && end->empty();
  if (!reference_ && (done ? convergence_->wants_check() : hangs_on_check())) {
    check();
    unchecked_ = unchecked_ && done;
    end = verdict();
  }
  if (end && end->empty() && !reference_ && misses_inside()) {
    check_beside_march();
    end = verdict();
  }
  note(options_.log, LogLevel::info, "%s on %ld steps: error %s, tolerance %.3g", to_string(solved_->method),
       long(solved_->steps),
       solved_->error_estimate ? text("about %.2e", *solved_->error_estimate).c_str() : "not known yet",
       goal_.smallest());
  return end;
}

// Steps of small problems take as long as so many operations beside those that are counted, and beside breakpoints
// there are steps of lengths of their own, each with its matrices.
double GridRefinement::operations(Index J) const {
  constexpr double of_step = 4000, of_breakpoint = 34, of_matrices = 10;
  const double size = double(scene_.states() + 2 * scene_.constraints());
  return predicted_cost(scene_, Method::march, J, 0).operations + of_step * double(J) +
         of_breakpoint * double(scene_.breakpoints.size()) * (of_step + of_matrices * size * size * size);
}

// By the order of the last grids, at most that of the methods.
double GridRefinement::operations_to_goal() const {
  constexpr double most = 2, least = 0.25;
  const double error = solved_ ? solved_->error_estimate.value_or(NAN) : NAN;
  if (!(error > goal_.smallest())) return operations(next_);
  const double before = estimates_.size() > 1 ? estimates_[estimates_.size() - 2] : NAN;
  const double order = before > 0 ? std::clamp(std::log2(before / error), least, most) : most;
  return operations(next_) * std::max(1.0, std::pow(error / goal_.smallest(), 1 / order) - 1);
}

std::string GridRefinement::spent(Index J) const {
  if (J > options_.max_steps)
    return text("more than %ld steps would be needed (--max-steps allows more)", long(options_.max_steps));
  if (options_.max_seconds > 0 && elapsed_ >= options_.max_seconds)
    return text("%.2g s are spent, of %.2g s that --max-seconds allows", elapsed_, options_.max_seconds);
  if (options_.max_seconds > 0 && elapsed_ + 2 * last_seconds_ > options_.max_seconds)
    return text("%ld steps would take about %.2g s, and %.2g of %.2g s are spent (--max-seconds allows more)", long(J),
                2 * last_seconds_, elapsed_, options_.max_seconds);
  return "";
}

std::optional<Result> GridRefinement::on_tree(double most_operations) {
  constexpr double of_leaf = 10;  // operations, beside those of a step of equal length, and its own factors
  constexpr Index more = 4;       // steps than before, or no other attempt is made
  const bool march = options_.method == Method::march || options_.method == Method::automatic;
  if (!march || solved_->method != Method::march || solved_->impacts) return std::nullopt;
  if (solved_->starts_with_impulse || solved_->magnification > most_growth) return std::nullopt;
  InnerOptions limited = options_;
  const double size = double(scene_.states() + 2 * scene_.constraints());
  const double most = most_operations / (of_leaf * (operations(2) - operations(1)) + size * size * size);
  if (most < double(limited.max_steps)) limited.max_steps = Index(most);
  if (limited.max_steps < std::max(2 * expected_, more * tried_tree_)) return std::nullopt;
  tried_tree_ = limited.max_steps;
  if (const std::string why = unsuited_to_radau_steps(scene_); !why.empty()) {
    note(options_.log, LogLevel::debug, "equal steps: %s", why.c_str());
    return std::nullopt;
  }
  std::optional<Result> result = march_to_tolerance(scene_, limited, expected_, *solved_);
  const double spent = clock_.lap();
  elapsed_ += spent;
  if (!result) return std::nullopt;
  ErrorEstimate& e = *result->errors;
  e.grids.insert(e.grids.begin(), grids_.begin(), grids_.end());
  e.estimates.insert(e.estimates.begin(), estimates_.begin(), estimates_.end());
  result->seconds = spent_;
  result->seconds.solve += spent;
  result->seconds.total += spent;
  return result;
}

Result GridRefinement::solve_on(Index J, Method method) {
  InnerOptions one = options_;
  one.method = method;
  one.tolerance = one.tolerance_x = one.tolerance_y = one.absolute_tolerance = 0;
  one.steps = J;
  one.tuning.algebraic_share = share_;
  one.iteration_tolerance = last_change_;
  one.fall_back_to_euler = false;
  one.compares_grids = true;
  one.look_inside_every_step = true;
  one.trace = true;  // what errors of N x hide of y
  RowMatrix start;
  if (solved_ && solved_->continuous && (2 * solved_->steps == J || solved_->steps == J)) {
    start = solved_->steps == J ? solved_->y : refined(solved_->y);
    one.tuning.first_iterate = &start;
  } else {
    one.tuning.first_iterate = grids_.empty() ? options_.tuning.first_iterate : nullptr;
  }
  const bool looks_inside = may_look_inside() || has_rough_intervals();
  if (looks_inside) one.states = StateSelection::all;
  const double before = clock_.lap();
  Result result = solve_on_steps(scene_, backend_, one);
  if (looks_inside) keep_recorded(result);
  last_seconds_ = clock_.lap();
  elapsed_ += before + last_seconds_;
  spent_ = spent_ + result.seconds;
  return result;
}

Result GridRefinement::blocks_by_march() {
  InnerOptions one = options_;
  one.tolerance = one.tolerance_x = one.tolerance_y = one.absolute_tolerance = 0;
  one.fall_back_to_euler = false;
  one.compares_grids = true;
  one.look_inside_every_step = true;
  const double before = clock_.lap();
  Result march = beside_march(scene_, backend_, one, *solved_, all_states_);
  elapsed_ += before + clock_.lap();
  return march;
}

void GridRefinement::keep_recorded(Result& result) {
  all_states_ = std::move(result.x);
  result.x_components = recorded_components(scene_, options_);
  result.x = all_states_(Eigen::all, result.x_components);
}

bool GridRefinement::is_final(const Result& next) const {
  if (next.status == Status::interrupted || next.infeasible_at == 0.0) return true;
  if (next.status == Status::infeasible && failed_ && failed_->status == Status::infeasible &&
      std::abs(*failed_->infeasible_at - *next.infeasible_at) <= 2 * scene_.T / double(failed_->steps))
    return next.steps >= expected_;
  return next.steps >= (next.status == Status::unsupported ? 1 : patience_with_failures) * expected_;
}

void GridRefinement::take(Result& next) {
  const bool same = solved_ && solved_->method == next.method && solved_->continuous == next.continuous &&
                    2 * solved_->steps == next.steps;
  if (!same || !convergence_) convergence_.emplace(scene_, next, sizes_);
  hidden_ = {};
  seen_before_ = same ? seen_ : NAN;
  seen_ = NAN;
  if (same) {
    convergence_->add(*solved_, next, next.steps >= expected_);
    hidden_ = hidden_error(scene_, *solved_, next, convergence_->share_of_difference(), sizes_);
  }
  shown_ = hides_error() ? 0 : shown_ + 1;
  solved_ = std::move(next);
  failed_.reset();
  unchecked_ = false;
  missed_ = 0;
  beside_march_.reset();
  look_for_reference();
  estimate();
}

void GridRefinement::look_for_reference() {
  if (tried_reference_ || solved_->steps < expected_) return;
  tried_reference_ = true;
  reference_ = EventReference::find(scene_, backend_, options_, sizes_,
                                    {goal_.smallest(), goal_.y > 0, goal_.x > 0, quick_events(scene_)}, solved_->steps);
  if (reference_) note(options_.log, LogLevel::info, "errors are those against a solution by located events");
}

void GridRefinement::iterate_on() {
  for (int k = 0; k < most_repeats && leaves_too_much(); ++k) {
    (solved_->algebraic_error ? share_ : last_change_) *=
        std::clamp(left_by_cycles / 2 * goal_.y / solved_->errors->iteration, 1e-6, 0.5);
    last_change_ = std::max(last_change_, least_change);
    Result next = solve_on(solved_->steps);
    if (next.status != Status::solved || next.method != solved_->method || next.continuous != solved_->continuous)
      return;
    solved_ = std::move(next);
    estimate();
  }
}

void GridRefinement::check() {
  unchecked_ = true;
  const Index J = solved_->steps;
  if (J % 4 != 0) return;
  RowMatrix of_solved = std::move(all_states_);
  const Result other = solve_on(J / 4 * 3);
  all_states_ = std::move(of_solved);
  grids_.insert(grids_.end() - 1, other.steps);
  estimates_.insert(estimates_.end() - 1, NAN);
  if (other.status != Status::solved || other.method != solved_->method || other.continuous != solved_->continuous)
    return;
  convergence_->check(other, *solved_);
  unchecked_ = false;
  estimate();
}

void GridRefinement::check_beside_march() {
  Result march;
  if (scene_.boundary)
    march = blocks_by_march();
  else if (Methods::has_small_dense_state(scene_))
    march = solve_on(solved_->steps, Method::march);
  if (march.status == Status::solved && !march.jumps_inside && march.x.cols() == solved_->x.cols()) {
    beside_march_ = distance(march, 1, *solved_, 1, sizes_);
    return estimate();
  }
  if (scene_.boundary) return;
  // March measures what rounding and growth do to the state, which method galerkin does not.
  if (march.status == Status::tolerance_not_met) return void(unchecked_ = true);
  if (!solved_->jumps_inside && !takes_g_at_points()) return void(unchecked_ = !solved_->interval_rules.empty());
  missed_ = missed_between_points(scene_.g, scene_.constraints(), scene_.breakpoints, solved_->t);
  unchecked_ = !(missed_ <= goal_.smallest());
}

Result GridRefinement::ended_by(Result& next) {
  if (!solved_ || next.status == Status::infeasible) return failed(next);
  const Status why = next.status == Status::interrupted ? next.status : Status::tolerance_not_met;
  return ended(text("with %ld steps: ", long(next.steps)) + next.reason, why);
}

Result GridRefinement::failed(Result& next) {
  next.errors.emplace().grids = grids_;
  next.errors->estimates = estimates_;
  next.errors->tolerance = goal_.smallest();
  next.seconds = spent_;
  return std::move(next);
}

Result GridRefinement::ended(const std::string& reason, Status status) {
  if (!solved_) return failed(*failed_);
  Result& result = *solved_;
  result.errors->grids = grids_;
  result.errors->estimates = estimates_;
  result.seconds = spent_;
  if (reason.empty()) return std::move(result);
  result.status = status;
  if (!result.error_estimate) {
    result.reason = "the error could not be estimated: " + reason;
    return std::move(result);
  }
  const double error = *result.error_estimate;
  const std::string steps = text("with %ld steps", long(result.steps));
  if (met())
    result.reason = text("the error, estimated as %.1e ", error) + steps + ", could not be confirmed: " + reason;
  else if (error <= goal_.smallest())
    result.reason = text("the error, estimated as %.1e ", error) + steps + ", is too near to the tolerance: " + reason;
  else
    result.reason = text("the error is about %.1e ", error) + steps + text(", not %.1e: ", goal_.smallest()) + reason;
  return std::move(result);
}

}  // namespace bromwich

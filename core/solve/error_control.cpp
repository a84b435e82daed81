#include "core/solve/error_control.hpp"

#include "core/accuracy/convergence.hpp"
#include "core/accuracy/interior_check.hpp"
#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/events/event_driven.hpp"
#include "core/scene/breakpoints.hpp"
#include "core/scene/natural_units.hpp"
#include "core/solve/event_control.hpp"
#include "core/solve/methods.hpp"
#include "core/solve/pieces.hpp"
#include "core/solve/prepared.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace bromwich {

namespace {

constexpr double accepted = 0.8;              ///< of the tolerance
constexpr double algebraic_share = 0.1;       ///< of a grid's discretisation error, that cycles may leave
constexpr double left_by_cycles = 0.1;        ///< of the tolerance: more is iterated away on the same grid
constexpr int most_repeats = 3;               ///< of a grid, for that
constexpr Index fewest_steps = 16;            ///< of a first grid of our choice
constexpr Index patience = 4;                 ///< times the scene's steps: below, nothing is called out of reach
constexpr Index patience_with_failures = 16;  ///< times the scene's steps: below, a failure is put down to the grid
constexpr Index patience_when_stalled = 64;   ///< times the scene's steps: solutions may come together late
constexpr double not_resolved = 0.1;          ///< differences above that say nothing of the order to come
constexpr double cheap = 2e8;                 ///< J (m + n)^2: below, grids are tried as long as the budget lasts
constexpr double out_of_reach = 4;            ///< times max_steps, predicted with the order that was seen
constexpr double quick = 1e9;     ///< floating-point operations: event-driven integration before grids are tried
constexpr double patient = 1e11;  ///< and after, where grids have not solved the scene, or the method is named

// What has to be reached: 0 where a kind is not controlled.
struct Goal {
  double y, x;

  explicit Goal(const Options& o)
      : y(o.tolerance_y > 0 ? o.tolerance_y : o.tolerance), x(o.tolerance_x > 0 ? o.tolerance_x : o.tolerance) {
    if (o.tolerance_y == 0 && o.tolerance_x == 0 && o.tolerance == 0) y = x = o.absolute_tolerance;
    if (!o.control_states) x = 0;
  }
  double smallest() const { return y > 0 && x > 0 ? std::min(y, x) : std::max(y, x); }
};

ComponentSizes sizes_for(const Scene& scene, const InnerOptions& o) {
  ComponentSizes sizes;
  sizes.relative = o.tolerance > 0 || o.tolerance_x > 0 || o.tolerance_y > 0;
  if (sizes.relative) sizes.absolute = o.absolute_tolerance / Goal(o).smallest();
  if (!o.units || o.units->trivial()) return sizes;
  const auto ones = [](const std::vector<int>& exponents, const std::vector<Index>& which) {
    Vector one(Index(which.size()));
    for (std::size_t i = 0; i < which.size(); ++i) one[Index(i)] = times_ten_to(-exponents[std::size_t(which[i])], 1);
    return one;
  };
  std::vector<Index> rows(o.units->y.size());
  std::iota(rows.begin(), rows.end(), Index(0));
  sizes.one_y = ones(o.units->y, rows);
  sizes.one_x = ones(o.units->x, recorded_components(scene, o));
  return sizes;
}

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

class GridRefinement {
 public:
  /// `measures`: errors may be those against located events.
  GridRefinement(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve& solve, bool measures)
      : scene_(scene),
        backend_(backend),
        options_(options),
        solve_(solve),
        goal_(options),
        sizes_(sizes_for(scene, options)),
        expected_(std::max(options.steps, scene.default_steps)),
        tried_reference_(!measures) {}

  Result run() {
    for (Index J = first_grid(scene_, options_);; J *= 2) {
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
        continue;
      }
      take(next);
      if (!reference_) iterate_on();
      std::optional<std::string> end = verdict();
      if (end && end->empty() && !reference_ && !holds_inside()) end = std::nullopt;
      if (end && end->empty() && !reference_ && convergence_->wants_check()) {
        check();
        end = verdict();
      }
      if (end && end->empty() && !reference_ && misses_inside()) {
        check_beside_march();
        end = verdict();
      }
      note(options_.log, LogLevel::info, "%s on %ld steps: error %s, tolerance %.3g", to_string(solved_->method),
           long(J), solved_->error_estimate ? text("about %.2e", *solved_->error_estimate).c_str() : "not known yet",
           goal_.smallest());
      if (end) return ended(*end);
      if (std::optional<Result> pieces = by_pieces()) return std::move(*pieces);
    }
  }

 private:
  // Which budget a grid of J steps would exceed; empty: none.
  std::string spent(Index J) const {
    if (J > options_.max_steps)
      return text("more than %ld steps would be needed (--max-steps allows more)", long(options_.max_steps));
    if (options_.max_seconds > 0 && elapsed_ + 2 * last_seconds_ > options_.max_seconds)
      return text("%ld steps would take about %.2g s, and %.2g of %.2g s are spent (--max-seconds)", long(J),
                  2 * last_seconds_, elapsed_, options_.max_seconds);
    return "";
  }

  // Steps of their own for parts of the time, once, where halving all of them would take many grids more.
  std::optional<Result> by_pieces() {
    const bool march = options_.method == Method::march || options_.method == Method::automatic;
    if (tried_pieces_ || !march || solved_->method != Method::march || solved_->steps < expected_) return std::nullopt;
    if (!solved_->continuous || solved_->jumps_inside || convergence_->of_integral()) return std::nullopt;
    const auto halvings = [](const GridDifferences& d, double goal) {
      return d.confirmed() ? d.halvings_to(accepted * goal) : 0;
    };
    const double needed = std::max(goal_.y > 0 ? halvings(convergence_->controlled(), goal_.y) : 0,
                                   controls_states() ? halvings(convergence_->states(), goal_.x) : 0);
    if (needed < fewest_halvings_for_pieces) return std::nullopt;
    tried_pieces_ = true;
    if (!unsuited_to_pieces(scene_).empty()) return std::nullopt;
    PieceGoal goal{goal_.y, controls_states() ? goal_.x : 0, sizes_};
    const double uniform = double(solved_->steps) * std::exp2(std::min(needed, 40.0));
    goal.most_steps = Index(std::min(double(options_.max_steps), uniform / worth_of_pieces));
    if (options_.max_seconds > 0) goal.most_seconds = std::max(options_.max_seconds - elapsed_, 1e-3) / 2;
    std::optional<Result> result = refine_pieces(scene_, backend_, options_, solve_, expected_, goal);
    const double spent = clock_.lap();
    elapsed_ += spent;
    if (!result) {
      note(options_.log, LogLevel::info, "grids of pieces do not meet the tolerance with fewer steps");
      return std::nullopt;
    }
    ErrorEstimate& e = *result->errors;
    e.grids.insert(e.grids.begin(), grids_.begin(), grids_.end());
    e.estimates.insert(e.estimates.begin(), estimates_.begin(), estimates_.end());
    result->seconds = result->seconds + spent_;
    note(options_.log, LogLevel::info, "solved on a grid of pieces: %ld steps, error about %.2e", long(e.grids.back()),
         *result->error_estimate);
    return result;
  }
  static constexpr double fewest_halvings_for_pieces = 4;
  static constexpr double worth_of_pieces = 4;  ///< times fewer steps than a uniform grid, at least

  void add_grid(Index J) {
    grids_.push_back(J);
    estimates_.push_back(NAN);
  }

  Result solve_on(Index J) { return solve_on(J, options_.method); }

  Result solve_on(Index J, Method method) {
    InnerOptions one = options_;
    one.method = method;
    one.tolerance = one.tolerance_x = one.tolerance_y = one.absolute_tolerance = 0;
    one.steps = J;
    one.tuning.algebraic_share = share_;
    one.fall_back_to_euler = false;
    one.compares_grids = true;
    one.look_inside_every_step = true;
    RowMatrix start;
    if (solved_ && solved_->continuous && (2 * solved_->steps == J || solved_->steps == J)) {
      start = solved_->steps == J ? solved_->y : refined(solved_->y);
      one.tuning.first_iterate = &start;
    } else {
      one.tuning.first_iterate = grids_.empty() ? options_.tuning.first_iterate : nullptr;
    }
    const bool looks_inside = may_look_inside();
    if (looks_inside) one.states = StateSelection::all;
    const double before = clock_.lap();
    Result result = solve_(scene_, backend_, one);
    if (looks_inside) keep_recorded(result);
    last_seconds_ = clock_.lap();
    elapsed_ += before + last_seconds_;
    spent_ = spent_ + result.seconds;
    return result;
  }

  bool may_look_inside() const {
    return Methods::has_small_dense_state(scene_) && scene_.constraints() > 0 && !scene_.boundary &&
           scene_.free_rows.empty();
  }

  // All states were recorded; those that the options ask for stay in the result.
  void keep_recorded(Result& result) {
    all_states_ = std::move(result.x);
    result.x_components = recorded_components(scene_, options_);
    result.x = all_states_(Eigen::all, result.x_components);
  }

  // Whether a grid that was not solved ends the search. On a coarse grid anything may go wrong.
  bool is_final(const Result& next) const {
    if (next.status == Status::interrupted || next.infeasible_at == 0.0) return true;
    if (next.status == Status::infeasible && failed_ && failed_->status == Status::infeasible &&
        std::abs(*failed_->infeasible_at - *next.infeasible_at) <= 2 * scene_.T / double(failed_->steps))
      return next.steps >= expected_;
    return next.steps >= (next.status == Status::unsupported ? 1 : patience_with_failures) * expected_;
  }

  void take(Result& next) {
    const bool same = solved_ && solved_->method == next.method && solved_->continuous == next.continuous &&
                      2 * solved_->steps == next.steps;
    if (!same || !convergence_) convergence_.emplace(scene_, next, sizes_);
    if (same) convergence_->add(*solved_, next, next.steps >= expected_);
    solved_ = std::move(next);
    failed_.reset();
    unchecked_ = false;
    beside_march_.reset();
    look_for_reference();
    estimate();
  }

  // A method that is named is measured against located events where these solve the scene (automatic takes these).
  void look_for_reference() {
    if (tried_reference_ || solved_->steps < expected_) return;
    tried_reference_ = true;
    reference_ = EventReference::find(scene_, backend_, options_, sizes_,
                                      {goal_.smallest(), goal_.y > 0, goal_.x > 0, quick}, solved_->steps);
    if (reference_) note(options_.log, LogLevel::info, "errors are those against a solution by located events");
  }

  // The error itself: that of y, or of its mean where y jumps, and that of x.
  void measure(ErrorEstimate& e) const {
    const Distance d = distance(*solved_, 1, reference_->on(solved_->steps), 1, sizes_);
    e.of_integral = !reference_->continuous() || convergence_->of_integral();
    e.iteration = e.rounding = 0;
    e.discretisation = std::max(rounding_of_rows, e.of_integral ? d.mean : d.y);
    if (controls_states()) e.states = std::max(rounding_of_rows, d.of_x());
  }
  static constexpr double rounding_of_rows = 64 * epsilon;

  // Cycles end where they leave a share of the largest error. Where that is too much for a small component, they go on.
  void iterate_on() {
    for (int k = 0; k < most_repeats && leaves_too_much(); ++k) {
      share_ *= std::clamp(left_by_cycles / 2 * goal_.y / solved_->errors->iteration, 1e-6, 0.5);
      Result next = solve_on(solved_->steps);
      if (next.status != Status::solved || next.method != solved_->method || next.continuous != solved_->continuous)
        return;
      solved_ = std::move(next);
      estimate();
    }
  }

  bool leaves_too_much() const {
    const ErrorEstimate& e = *solved_->errors;
    if (goal_.y == 0 || !solved_->algebraic_error || solved_->steps < expected_) return false;
    return e.iteration > left_by_cycles * goal_.y && e.iteration > discretisation(e);
  }

  bool holds_inside() {
    const bool piecewise_linear = solved_->continuous && !by_euler(*solved_) && solved_->method != Method::galerkin;
    if (!piecewise_linear || !may_look_inside() || !all_states_.allFinite()) return true;
    solved_->errors->interior = interior_defect(scene_, *solved_, all_states_, sizes_);
    return solved_->errors->interior <= goal_.smallest();
  }

  // Jumps that stay in their steps when these are halved do not on a grid of 3/4 of the steps. Where that cannot be
  // compared the estimate is not relied on.
  void check() {
    unchecked_ = true;
    const Index J = solved_->steps;
    if (J % 4 != 0) return;
    const Result other = solve_on(J / 4 * 3);
    grids_.insert(grids_.end() - 1, other.steps);
    estimates_.insert(estimates_.end() - 1, NAN);
    if (other.status != Status::solved || other.method != solved_->method || other.continuous != solved_->continuous)
      return;
    convergence_->check(other, *solved_);
    unchecked_ = false;
    estimate();
  }

  // g that jumps inside steps enters contour, multigrid and Euler by its values at their ends: a pulse between them is
  // in no difference of grids. Method march takes such steps in parts.
  // So does it where the state jumps, which method galerkin sees late on all grids.
  bool misses_inside() const {
    const bool galerkin = solved_->method == Method::galerkin && options_.method == Method::galerkin;
    return solved_->jumps_inside ||
           (galerkin && !scene_.boundary && scene_.free_rows.empty() && Methods::has_small_dense_state(scene_));
  }

  void check_beside_march() {
    Result march;
    if (Methods::has_small_dense_state(scene_)) march = solve_on(solved_->steps, Method::march);
    if (march.status == Status::solved && !march.jumps_inside && march.x.cols() == solved_->x.cols()) {
      beside_march_ = distance(march, 1, *solved_, 1, sizes_);
      return estimate();
    }
    if (!solved_->jumps_inside) return void(unchecked_ = !solved_->interval_rules.empty());
    const double missed = missed_between_points(scene_.g, scene_.constraints(), scene_.breakpoints, solved_->t);
    unchecked_ = !(missed <= goal_.smallest());
  }

  void estimate() {
    ErrorEstimate e;
    e.tolerance = goal_.smallest();
    e.of_integral = convergence_->of_integral();
    const RowMatrix controlled = e.of_integral ? integral_of_y(*solved_) / scene_.T : solved_->y;
    const double largest = controlled.bottomRows(solved_->steps).cwiseAbs().maxCoeff();
    const Vector sizes = e.of_integral ? sizes_.of_mean(*solved_) : sizes_.of_y(*solved_);
    const double size = sizes.maxCoeff(), smallest = sizes.minCoeff();
    const auto relative = [](double error, double to) { return error > 0 ? error / to : 0; };
    e.kernel = solved_->kernel_error * relative(largest, size);
    e.iteration = relative(
        solved_->algebraic_error.value_or(iteration_error(solved_->history)) * std::max(1.0, largest), smallest);
    e.rounding = relative(e.of_integral ? solved_->rounding * largest : solved_->rounding_of_y, size);
    e.discretisation = convergence_->error();
    e.order = (goal_.y > 0 ? convergence_->controlled() : convergence_->states()).observed_order();
    if (controls_states()) e.states = convergence_->error_of_x() + solved_->rounding;
    if (beside_march_) {
      e.discretisation = std::max(e.discretisation, e.of_integral ? beside_march_->mean : beside_march_->y);
      e.states = std::max(e.states, beside_march_->of_x());
    }
    if (reference_ && solved_->steps >= expected_) measure(e);
    e.grids = grids_;
    solved_->errors = e;
    solved_->error_estimate.reset();
    if (goal_.y == 0 && !std::isnan(e.states)) solved_->error_estimate = e.states;
    if (goal_.y > 0 && !std::isnan(e.discretisation))
      solved_->error_estimate = std::max(e.total(), controls_states() ? e.states : 0);
    estimates_.back() = solved_->error_estimate.value_or(NAN);
  }

  bool controls_states() const { return goal_.x > 0 && solved_->x.cols() > 0; }

  // Whether the estimates can be relied on.
  bool judged() const {
    if (reference_) return solved_->error_estimate.has_value();
    if (unchecked_ || !solved_->error_estimate || solved_->unresolved_sources > goal_.smallest()) return false;
    if (goal_.y > 0 && !convergence_->can_be_judged(goal_.y)) return false;
    const GridDifferences& x = convergence_->states();
    return !controls_states() || x.negligible(goal_.x) || (x.confirmed() && !x.changes_abruptly());
  }

  bool met() const {
    const ErrorEstimate& e = *solved_->errors;
    return (goal_.y == 0 || e.total() <= accepted * goal_.y) && (!controls_states() || e.states <= accepted * goal_.x);
  }

  // Empty: the tolerance is met. Nothing: go on. Otherwise why it will not be met.
  std::optional<std::string> verdict() const {
    if (solved_->steps >= expected_ && judged() && met()) return "";
    if (solved_->steps < patience * expected_) return std::nullopt;
    if (const std::string limit = limit_of_grids(); !limit.empty()) return limit;
    if (unchecked_ && misses_inside())
      return solved_->jumps_inside
                 ? "g jumps inside steps, and this method takes its values at their ends alone: use method march"
                 : "the state may jump, and method march does not solve the same grid to compare it with";
    if (unchecked_)
      return text(
          "with %ld steps, whose points jumps of y do not share, another method is taken or none solves the scene",
          long(solved_->steps / 4 * 3));
    const ErrorEstimate& e = *solved_->errors;
    if (goal_.y > 0)
      if (const auto why = hopeless(convergence_->controlled(), goal_.y, e.total() - discretisation(e),
                                    e.of_integral ? "the mean of y" : "y"))
        return why;
    if (controls_states()) return hopeless(convergence_->states(), goal_.x, solved_->rounding, "the states");
    return std::nullopt;
  }

  static double discretisation(const ErrorEstimate& e) { return std::isnan(e.discretisation) ? 0 : e.discretisation; }

  // What no grid changes.
  std::string limit_of_grids() const {
    const ErrorEstimate& e = *solved_->errors;
    if (goal_.y > 0 && e.total() - discretisation(e) > accepted * goal_.y)
      return text(
          "the weights of the kernel are known to %s, the iteration leaves %.1e and rounding %.1e: no grid does better",
          std::isnan(e.kernel) ? "full precision" : text("%.1e", e.kernel).c_str(), e.iteration, e.rounding);
    if (!reference_ && controls_states() && solved_->rounding > accepted * goal_.x)
      return text("rounding makes errors of %.1e in the states: no grid does better", solved_->rounding);
    return "";
  }

  std::optional<std::string> hopeless(const GridDifferences& d, double goal, double other, const char* what) const {
    if (!d.confirmed() || d.error() + other <= accepted * goal) return std::nullopt;
    const double width = double(scene_.states() + scene_.constraints());
    const bool patient =
        solved_->steps < patience_when_stalled * expected_ || double(solved_->steps) * width * width < cheap;
    if (!patient && d.stalled(window_when_stalled))
      return text("halving the step does not bring the solutions together any more: %s still moves by %.1e", what,
                  d.last());
    if (patient && (!d.regular() || d.last() > not_resolved)) return std::nullopt;
    const double needed = double(solved_->steps) * std::exp2(d.halvings_to(accepted * goal - other));
    if (needed > out_of_reach * double(options_.max_steps))
      return text("about %.0e steps would be needed (--max-steps allows %ld)", needed, long(options_.max_steps));
    return std::nullopt;
  }
  static constexpr std::size_t window_when_stalled = 3;

  // What a coarser grid has found stays, except where the scene has no solution.
  Result ended_by(Result& next) {
    if (!solved_ || next.status == Status::infeasible) return failed(next);
    const Status why = next.status == Status::interrupted ? next.status : Status::tolerance_not_met;
    return ended(text("with %ld steps: ", long(next.steps)) + next.reason, why);
  }

  Result failed(Result& next) {
    next.errors.emplace().grids = grids_;
    next.errors->estimates = estimates_;
    next.errors->tolerance = goal_.smallest();
    next.seconds = spent_;
    return std::move(next);
  }

  Result ended(const std::string& reason, Status status = Status::tolerance_not_met) {
    if (!solved_) return failed(*failed_);
    Result& result = *solved_;
    result.errors->grids = grids_;
    result.errors->estimates = estimates_;
    result.seconds = spent_;
    if (reason.empty()) return std::move(result);
    result.status = status;
    const bool small = result.error_estimate && met();
    result.reason =
        small ? text("the error, estimated as %.1e with %ld steps, could not be confirmed: ", *result.error_estimate,
                     long(result.steps)) +
                    reason
        : result.error_estimate ? text("the error is about %.1e with %ld steps, not %.1e: ", *result.error_estimate,
                                       long(result.steps), goal_.smallest()) +
                                      reason
                                : "the error could not be estimated: " + reason;
    return std::move(result);
  }

  const Scene& scene_;
  Backend& backend_;
  const InnerOptions& options_;
  const Solve& solve_;
  const Goal goal_;
  const ComponentSizes sizes_;
  const Index expected_;  ///< steps with which the scene is meant to be solved
  std::vector<Index> grids_;
  std::vector<double> estimates_;           ///< of grids_
  std::optional<Result> solved_, failed_;   ///< the last grid of each kind; failed_ only if it is the last of all
  std::optional<Convergence> convergence_;  ///< of the grids that the method of solved_ has solved
  bool tried_pieces_ = false;
  bool tried_reference_;
  std::optional<EventReference> reference_;
  bool unchecked_ = false;  ///< the grid that checks the last one could not
  double share_ = algebraic_share;
  std::optional<Distance> beside_march_;  ///< of the last grid, where g jumps inside steps
  RowMatrix all_states_;                  ///< of the last grid, where there are few
  Seconds spent_;
  Timer clock_;
  double elapsed_ = 0, last_seconds_ = 0;
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

namespace {

// The scene with all breakpoints of its sources; nothing if these are known already.
std::optional<Scene> with_breakpoints(const Scene& given) {
  if (given.breakpoints_are_all || (!given.f && !given.g)) return std::nullopt;
  std::vector<double> all = find_breakpoints(given);
  if (all.size() == given.breakpoints.size()) return std::nullopt;
  std::optional<Scene> scene = given;
  scene->breakpoints = std::move(all);
  scene->breakpoints_are_all = true;
  return scene;
}

EventGoal event_goal(const InnerOptions& options, double most_work) {
  if (!controls_error(options)) return {0, true, true, most_work};
  const Goal goal(options);
  return {goal.smallest(), goal.y > 0, goal.x > 0, most_work};
}

Result by_grids(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve& solve) {
  Result result = GridRefinement(scene, backend, options, solve, options.method != Method::automatic).run();
  const bool failed = result.status == Status::tolerance_not_met && !result.error_estimate;
  if (options.method != Method::automatic || !failed || scene.boundary) return result;
  // No grid was solved by a method of second order.
  note(options.log, LogLevel::info, "no grid is solved by a method of second order: implicit Euler");
  InnerOptions by_euler = options;
  by_euler.method = Method::euler;
  Result first_order = GridRefinement(scene, backend, by_euler, solve, false).run();
  if (first_order.status != Status::solved) return result;
  add_warning(first_order,
              "solved by implicit Euler, of first order: the methods of second order end with: " + result.reason);
  return first_order;
}

}  // namespace

Result solve_by_events(const Scene& given, Backend& backend, const InnerOptions& options) {
  const std::optional<Scene> with = with_breakpoints(given);
  return solve_by_events(with ? *with : given, backend, options, sizes_for(given, options),
                         event_goal(options, patient));
}

Result solve_to_tolerance(const Scene& given, Backend& backend, const InnerOptions& asked, const Solve& solve) {
  std::optional<Scene> with = with_breakpoints(given);
  InnerOptions options = asked;
  if (!options.prepared) options.prepared = std::make_shared<Prepared>();
  if (!options.family) options.family = std::make_shared<GridFamily>(true);
  if (!with && !options.prepared->stated) with = given;  // a copy, whose values nobody else can change
  const Scene& scene = with ? *with : given;
  if (options.method != Method::automatic || !unsuited_to_events(scene).empty())
    return by_grids(scene, backend, options, solve);
  const auto by_events = [&](double most_work) {
    return solve_by_events(scene, backend, options, sizes_for(scene, options), event_goal(options, most_work));
  };
  Result events = by_events(quick);
  if (events.status == Status::solved || events.status == Status::interrupted) return events;
  Result result = by_grids(scene, backend, options, solve);
  if (options.max_seconds > 0 || result.status != Status::tolerance_not_met || events.reason.rfind(out_of_work, 0) != 0)
    return result;
  events = by_events(patient);
  return events.status == Status::solved ? events : result;
}

}  // namespace bromwich

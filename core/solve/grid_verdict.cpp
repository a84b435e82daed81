// Estimates of the errors of a grid, and whether they meet the tolerance.

#include "core/base/text.hpp"
#include "core/numerics/irregular.hpp"
#include "core/scene/source_steps.hpp"
#include "core/solve/error_control.hpp"
#include "core/solve/grid_refinement.hpp"
#include "core/solve/methods.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index patience = 4;                ///< times the scene's steps: below, nothing is called out of reach
constexpr Index patience_when_stalled = 64;  ///< times the scene's steps: solutions may come together late
constexpr double not_resolved = 0.1;         ///< differences above that say nothing of the order to come
constexpr double cheap = 2e8;                ///< J (m + n)^2: below, grids are tried as long as the budget lasts
constexpr double out_of_reach = 4;           ///< times max_steps, predicted with the order that was seen
constexpr double rounding_of_rows = 64 * epsilon;
constexpr std::size_t window_when_stalled = 3;
constexpr double shortest_piece = 0x1p-16;  ///< of a step: sources are looked at in no shorter pieces
constexpr int looks_at_sources = 32;

// Whether a source is no line on most of some intervals, which lie at irregular times: more than `share` of its size.
bool changes_within(const TimeFunction& source, Index width, double T, double length, double share) {
  if (!source || width == 0) return false;
  constexpr double inside = 0.3819660112501051;
  double size = 0;
  Vector from(width), between(width), to(width), off(looks_at_sources);
  for (int k = 0; k < looks_at_sources; ++k) {
    const double t = (T - length) * irregular(k + 1);
    source(t, from);
    source(t + inside * length, between);
    source(t + length, to);
    off[k] = (between - (1 - inside) * from - inside * to).cwiseAbs().maxCoeff();
    size = std::max(size, from.cwiseAbs().maxCoeff());
  }
  return (off.array() > share * size).count() > looks_at_sources / 2;
}

}  // namespace

bool GridRefinement::may_look_inside() const {
  return Methods::has_small_dense_state(scene_) && scene_.constraints() > 0 && !scene_.boundary &&
         scene_.free_rows.empty();
}

void GridRefinement::measure(ErrorEstimate& e) const {
  Result rows = reference_->on(solved_->steps);
  const Result& own = *solved_;
  if (jumps_at_end(scene_))
    for (RowMatrix Result::*table : {&Result::y, &Result::y_integral, &Result::x})
      if ((rows.*table).size() > 0 && (own.*table).size() > 0) (rows.*table).bottomRows(1) = (own.*table).bottomRows(1);
  const Distance d = distance(own, 1, rows, 1, sizes_);
  e.of_integral = !reference_->continuous() || convergence_->of_integral();
  e.iteration = e.rounding = 0;
  e.discretisation = std::max(rounding_of_rows, e.of_integral ? d.mean : d.y);
  if (controls_states()) e.states = std::max(rounding_of_rows, d.of_x());
}

bool GridRefinement::leaves_too_much() const {
  const ErrorEstimate& e = *solved_->errors;
  if (goal_.y == 0 || solved_->steps < expected_) return false;
  if (!solved_->algebraic_error && !iterates(solved_->method)) return false;
  return e.iteration > left_by_cycles * goal_.y && e.iteration > discretisation(e);
}

bool GridRefinement::holds_inside() {
  const bool piecewise_linear = solved_->continuous && !by_euler(*solved_) && solved_->method != Method::galerkin;
  if (!piecewise_linear || !may_look_inside() || !all_states_.allFinite()) return true;
  solved_->errors->interior = interior_defect(scene_, *solved_, all_states_, sizes_);
  return solved_->errors->interior <= goal_.smallest();
}

bool GridRefinement::misses_inside() const {
  const bool galerkin = solved_->method == Method::galerkin && options_.method == Method::galerkin;
  return solved_->jumps_inside || takes_g_at_points() || has_rough_intervals() ||
         (galerkin && !scene_.boundary && scene_.free_rows.empty() && Methods::has_small_dense_state(scene_));
}

bool GridRefinement::takes_g_at_points() const {
  return scene_.g && !scene_.breakpoints.empty() && !scene_.boundary && scene_.free_rows.empty() &&
         !Methods::has_small_dense_state(scene_) && !solved_->defects;
}

bool GridRefinement::has_rough_intervals() const {
  return scene_.boundary && !scene_.breakpoints.empty() && scene_.free_rows.empty() && scene_.constraints() > 0 &&
         Methods::has_small_dense_state(scene_);
}

void GridRefinement::estimate() {
  ErrorEstimate e;
  e.tolerance = goal_.smallest();
  e.of_integral = convergence_->of_integral();
  const RowMatrix controlled = e.of_integral ? integral_of_y(*solved_) / scene_.T : solved_->y;
  const double largest = controlled.bottomRows(solved_->steps).cwiseAbs().maxCoeff();
  const Vector sizes = e.of_integral ? sizes_.of_mean(*solved_) : sizes_.of_y(*solved_);
  const double size = sizes.maxCoeff(), smallest = sizes.minCoeff();
  const auto relative = [](double error, double to) { return error > 0 ? error / to : 0; };
  e.kernel = solved_->kernel_error * relative(largest, size);
  e.iteration =
      relative(solved_->algebraic_error.value_or(iteration_error(solved_->history)) * std::max(1.0, largest), smallest);
  e.rounding = relative(e.of_integral ? solved_->rounding * largest : solved_->rounding_of_y, size);
  e.discretisation = convergence_->error();
  e.discretisation = std::max(e.discretisation, e.of_integral ? hidden_.mean : hidden_.largest);
  e.order = (goal_.y > 0 ? convergence_->controlled() : convergence_->states()).observed_order();
  if (controls_states()) e.states = convergence_->error_of_x() + solved_->rounding;
  if (beside_march_) {
    e.discretisation = std::max(e.discretisation, e.of_integral ? beside_march_->mean : beside_march_->y);
    e.states = std::max(e.states, beside_march_->of_x());
  }
  if (!reference_ && !may_look_inside()) doubt_sudden_drops(e);
  if (reference_ && solved_->steps >= expected_) measure(e);
  e.grids = grids_;
  solved_->errors = e;
  solved_->error_estimate.reset();
  if (goal_.y == 0 && !std::isnan(e.states)) solved_->error_estimate = e.states;
  if (goal_.y > 0 && !std::isnan(e.discretisation))
    solved_->error_estimate = std::max(e.total(), controls_states() ? e.states : 0);
  estimates_.back() = solved_->error_estimate.value_or(NAN);
}

// Grids are compared at the points of the coarser one. Where the solution changes within a step, as in a contact that
// begins between points, the others may be worse, and then the error falls faster than the method allows.
void GridRefinement::doubt_sudden_drops(ErrorEstimate& e) {
  constexpr double fastest = 10;  // third order: 8
  const auto larger = [](double a, double b) { return std::isnan(a) ? b : std::isnan(b) ? a : std::max(a, b); };
  seen_ = larger(e.discretisation, e.states);
  if (!std::isfinite(seen_) || !std::isfinite(seen_before_) || seen_ >= seen_before_ / fastest) return;
  const double doubted = seen_before_ / 2;  // as of first order, until another grid is solved
  if (!std::isnan(e.discretisation)) e.discretisation = std::max(e.discretisation, doubted);
  if (!std::isnan(e.states)) e.states = std::max(e.states, doubted);
}

bool GridRefinement::judged() const {
  if (reference_) return solved_->error_estimate.has_value();
  if (unchecked_ || !solved_->error_estimate || solved_->unresolved_sources > goal_.smallest()) return false;
  if (goal_.y > 0 && !convergence_->can_be_judged(goal_.y)) return false;
  const GridDifferences& x = convergence_->states();
  return !controls_states() || x.negligible(goal_.x) || (x.confirmed() && !x.changes_abruptly());
}

bool GridRefinement::met() const {
  const ErrorEstimate& e = *solved_->errors;
  return (goal_.y == 0 || e.total() <= accepted * goal_.y) && (!controls_states() || e.states <= accepted * goal_.x);
}

bool GridRefinement::hangs_on_check() const {
  if (goal_.y == 0 || solved_->steps < expected_ || solved_->steps % 4 != 0 || !judged()) return false;
  if (controls_states() && solved_->errors->states > accepted * goal_.x) return false;
  return convergence_->hangs_on_check(accepted * goal_.y);
}

std::optional<std::string> GridRefinement::verdict() const {
  if (solved_->steps >= expected_ && judged() && met()) return "";
  const double piece = scene_.T / double(options_.max_steps) * shortest_piece, goal = goal_.smallest();
  if (solved_->unresolved_sources > goal && (changes_within(scene_.f, scene_.sources(), scene_.T, piece, goal) ||
                                             changes_within(scene_.g, scene_.constraints(), scene_.T, piece, goal)))
    return text("f or g changes within %.1e of T, which no grid of %ld steps resolves: is T in the unit of t?",
                piece / scene_.T, long(options_.max_steps));
  if (solved_->steps < patience * expected_) return std::nullopt;
  if (const std::string limit = limit_of_grids(); !limit.empty()) return limit;
  if (unchecked_ && misses_inside()) return why_unchecked();
  if (unchecked_)
    return text(
        "with %ld steps, whose points jumps of y do not share, another method is taken or none solves the scene",
        long(solved_->steps / 4 * 3));
  const ErrorEstimate& e = *solved_->errors;
  if (goal_.y > 0)
    if (const auto why = hopeless(convergence_->controlled(), goal_.y, e.total() - discretisation(e),
                                  e.of_integral ? "the mean of y" : "y"))
      return why;
  if (controls_states()) return hopeless(convergence_->states(), goal_.x, solved_->rounding, "the state");
  return std::nullopt;
}

std::optional<std::string> GridRefinement::why_unchecked() const {
  if (!solved_->jumps_inside && !takes_g_at_points())
    return "the state may jump or is faster than a step, and method march does not solve the same grid to compare it "
           "with";
  const std::string jumps =
      "g jumps or has a kink inside steps, and this method takes its values at their ends alone: ";
  // Other scenes whose steps are not divided are marched with the same values.
  if (solved_->method != Method::march && Methods::has_small_dense_state(scene_)) return jumps + "use method march";
  const double needed = double(solved_->steps) * missed_ / goal_.smallest();  // first order
  if (needed <= double(std::min(patience_when_stalled * expected_, options_.max_steps))) return std::nullopt;
  return jumps + text("about %.1e steps would be needed", needed);
}

std::string GridRefinement::limit_of_grids() const {
  const ErrorEstimate& e = *solved_->errors;
  // What cycles leave beside a larger error of the grid becomes less on finer grids.
  const double left = e.iteration > discretisation(e) ? e.iteration : 0;
  if (goal_.y > 0 && e.total() - discretisation(e) - e.iteration + left > accepted * goal_.y)
    return text(
        "the weights of the kernel are known to %s, the iteration leaves %.1e and rounding %.1e: no grid does better",
        std::isnan(e.kernel) ? "full precision" : text("%.1e", e.kernel).c_str(), e.iteration, e.rounding);
  if (!reference_ && controls_states() && solved_->rounding > accepted * goal_.x)
    return text("rounding makes errors of %.1e in the states: no grid does better", solved_->rounding);
  return "";
}

std::optional<std::string> GridRefinement::hopeless(const GridDifferences& d, double goal, double other,
                                                    const char* what) const {
  if (!d.confirmed() || d.error() + other <= accepted * goal || shown_ < window_when_stalled) return std::nullopt;
  const double width = double(scene_.states() + scene_.constraints());
  const bool patient =
      solved_->steps < patience_when_stalled * expected_ || double(solved_->steps) * width * width < cheap;
  if (!patient && shown_ >= 2 * window_when_stalled && d.stalled(window_when_stalled))
    return text("halving the step does not bring the solutions together any more: %s still changes by %.1e", what,
                d.last());
  if (!d.regular() || d.last() > not_resolved) return std::nullopt;
  const double needed = double(solved_->steps) * std::exp2(d.fewest_halvings_to(accepted * goal - other));
  if (needed > out_of_reach * double(options_.max_steps))
    return text("about %.0e steps would be needed (--max-steps allows %ld)", needed, long(options_.max_steps));
  return std::nullopt;
}

}  // namespace bromwich

#include "core/solve/adapted_march.hpp"

#include "core/adapted/radau_steps.hpp"
#include "core/adapted/tree_control.hpp"
#include "core/base/text.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/march/outcome.hpp"
#include "core/result/located.hpp"
#include "core/result/slack.hpp"
#include "core/solve/error_goal.hpp"
#include "core/solve/event_rows.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

ComponentSizes sizes_of_all_states(const Scene& scene, InnerOptions options) {
  options.states = StateSelection::all;
  return sizes_for(scene, options);
}

double relative(double error, const Vector& size) { return error > 0 ? error / size.maxCoeff() : 0; }

TreeGoal goal_of(const Scene& scene, const InnerOptions& options, const Result& first) {
  const ErrorGoal tolerances(options);
  TreeGoal goal;
  goal.y = tolerances.y;
  goal.x = tolerances.x;
  goal.sizes = sizes_of_all_states(scene, options);
  goal.y_may_jump = !is_continuous(known_class(scene.M, scene.lcp_class));
  goal.impulse = first.starts_with_impulse;
  const double largest = integral_of_y(first).bottomRows(first.steps).cwiseAbs().maxCoeff() / scene.T;
  goal.rounding_of_y = relative(first.rounding_of_y, goal.sizes.of_y(first)) / double(first.steps);
  goal.rounding_of_mean = relative(first.rounding * largest, goal.sizes.of_mean(first)) / double(first.steps);
  goal.rounding_of_x = first.rounding / double(first.steps);
  return goal;
}

ErrorEstimate estimate_of(const TreeSolution& s, const TreeGoal& goal, const std::vector<Index>& components) {
  ErrorEstimate e;
  e.tolerance = goal.y > 0 && goal.x > 0 ? std::min(goal.y, goal.x) : std::max(goal.y, goal.x);
  e.of_integral = s.of_integral;
  e.rounding = double(s.steps) * (s.of_integral ? goal.rounding_of_mean : goal.rounding_of_y);
  if (goal.y > 0) e.discretisation = s.error_of_y();
  if (goal.x > 0 && !components.empty())
    e.states = s.error.x(components).maxCoeff() + double(s.steps) * goal.rounding_of_x;
  e.grids = {s.steps / 2, s.steps};
  const double of_y = goal.y > 0 ? e.total() : 0;
  e.estimates = {NAN, std::isnan(e.states) ? of_y : std::max(of_y, e.states)};
  return e;
}

std::string kernel_of(const std::vector<Part>& leaves, double T) {
  const auto [least, most] = std::minmax_element(leaves.begin(), leaves.end(),
                                                 [](const Part& a, const Part& b) { return a.length < b.length; });
  return text("Radau IIA on the state, %zu steps of their own lengths, from %.2g T to %.2g T", 2 * leaves.size(),
              least->length / 2 / T, most->length / 2 / T);
}

// Whether each interval beside a breakpoint or between given times may have a factorization for each of its lengths.
bool affords_exact_times(const Scene& scene, Index times) {
  constexpr double levels = 17, operations = 3e9;
  const double intervals = 2 * double(scene.breakpoints.size()) + double(times),
               size = double(scene.states() + 2 * scene.constraints());
  return intervals * levels * size * size * size <= operations;
}

// Of rows with a trace: y against w on the side of y.
double residual_of(const Scene& scene, const Result& r) {
  const RowMatrix w = slack(scene, r);
  double worst = 0;
  for (Index j = 1; j <= r.steps; ++j) {
    const Vector y = r.y.row(j).transpose(), here = w.row(j).transpose();
    const double size = std::max(1.0, (here - multiply(scene.M, y)).cwiseAbs().maxCoeff());
    worst = std::max(worst, y.cwiseMin(here).cwiseAbs().maxCoeff() / size);
  }
  return worst;
}

}  // namespace

std::optional<Result> march_to_tolerance(const Scene& scene, const InnerOptions& options, Index cells,
                                         const Result& first, const Vector& times) {
  const Vector zero = Vector::Zero(scene.constraints()), y0 = first.y.row(0).transpose();
  RadauSteps steps(scene, known_class(scene.M, scene.lcp_class));
  TreeMarch tree(
      scene.T, cells, scene.breakpoints, times.size() > 0 ? times : time_grid(scene.T, cells),
      affords_exact_times(scene, times.size()), {scene.x0, y0.allFinite() ? y0 : zero, zero},
      [&steps](const Part& p, const TreeRow& from, TreeRow& to) { return steps.take(p, from, to); },
      std::size_t(options.max_steps));
  const TreeGoal goal = goal_of(scene, options, first);
  std::optional<TreeSolution> solution = march_to_goal(tree, goal);
  if (!solution || !steps.well_posed()) return std::nullopt;
  Result result = first;
  result.x_components = recorded_components(scene, options);
  result.errors = estimate_of(*solution, goal, result.x_components);
  result.error_estimate = result.errors->estimates.back();
  result.kernel = kernel_of(tree.leaves(), scene.T);
  if (result.starts_with_impulse) result.kernel += impulse_note;
  result.well_posed = true;
  result.lcp.solved = steps.problems();
  result.lcp.newton = steps.newton();
  result.warning.clear();
  result.continuous = result.jumps_inside = false;
  result.unresolved_sources = 0;
  result.euler_steps = 0;
  result.defects = nullptr;
  Result rows = as_result(tree.times(), std::move(solution->rows));
  solve_at_own_values(scene, known_class(scene.M, scene.lcp_class), rows_at_breakpoints(scene, rows.t), rows.x, rows.t,
                      rows.y);
  rows.method = result.method, rows.errors = result.errors;
  rows.trace = rows.x * scene.dynamics->outputs().transpose();
  result.residual = residual_of(scene, rows);
  if (options.trace) result.trace = std::move(rows.trace);
  result.x = rows.x(Eigen::all, result.x_components);
  result.t = std::move(rows.t);
  result.steps = rows.steps;
  result.y = std::move(rows.y);
  result.y_integral = std::move(rows.y_integral);
  return result;
}

}  // namespace bromwich

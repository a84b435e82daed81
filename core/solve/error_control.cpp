#include "core/solve/error_control.hpp"

#include "core/base/text.hpp"
#include "core/events/event_driven.hpp"
#include "core/scene/breakpoints.hpp"
#include "core/solve/error_goal.hpp"
#include "core/solve/event_control.hpp"
#include "core/solve/grid_refinement.hpp"
#include "core/solve/prepared.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

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

/// Of T: where so much is done when the operations are spent, the integration gets as many as the rest may take.
constexpr double worth_going_on = 0.25;

/// The part of [0, T] that an integration without an end has come through.
double reached(const Result& events) {
  Index rows = 1;  // y(0) may be open where the rest is known
  while (rows < events.y.rows() && events.y.row(rows).allFinite()) ++rows;
  return double(rows) / double(std::max<Index>(1, events.y.rows()));
}

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

Result by_grids(const Scene& scene, Backend& backend, const InnerOptions& options) {
  Result result = GridRefinement(scene, backend, options, options.method != Method::automatic).run();
  const bool failed = result.status == Status::tolerance_not_met && !result.error_estimate;
  if (options.method != Method::automatic || !failed || scene.boundary) return result;
  // No grid was solved by a method of second order.
  note(options.log, LogLevel::info, "no grid is solved by a method of second order: implicit Euler");
  InnerOptions by_euler = options;
  by_euler.method = Method::euler;
  Result first_order = GridRefinement(scene, backend, by_euler, false).run();
  if (first_order.status != Status::solved) return result;
  add_warning(first_order,
              "solved by implicit Euler, of first order: the methods of second order end with: " + result.reason);
  return first_order;
}

}  // namespace

Result solve_by_events(const Scene& given, Backend& backend, const InnerOptions& options) {
  const std::optional<Scene> with = with_breakpoints(given);
  return solve_by_events(with ? *with : given, backend, options, sizes_for(given, options),
                         event_goal(options, patient_events));
}

Result solve_to_tolerance(const Scene& given, Backend& backend, const InnerOptions& asked) {
  std::optional<Scene> with = with_breakpoints(given);
  InnerOptions options = asked;
  if (!options.prepared) options.prepared = std::make_shared<Prepared>();
  if (!options.family) options.family = std::make_shared<GridFamily>(true);
  if (!with && !options.prepared->stated) with = given;  // a copy, whose values nobody else can change
  const Scene& scene = with ? *with : given;
  if (options.method != Method::automatic || !unsuited_to_events(scene).empty())
    return by_grids(scene, backend, options);
  const auto by_events = [&](double most_work) {
    return solve_by_events(scene, backend, options, sizes_for(scene, options), event_goal(options, most_work));
  };
  const double quick = quick_events(scene);
  Result events = by_events(quick);
  if (events.reason.rfind(out_of_work, 0) == 0 && reached(events) >= worth_going_on)
    events = by_events(1.25 / worth_going_on * quick);
  if (events.status == Status::solved || events.status == Status::interrupted) return events;
  if (events.reason.rfind(not_unique, 0) == 0) return events;  // no grid decides which one it is
  Result result = by_grids(scene, backend, options);
  if (result.status == Status::solved && events.reason.rfind(several_solutions, 0) == 0 &&
      result.warning.find(several_solutions) == std::string::npos)
    add_warning(result, events.reason);  // grids go to one of them, and may all go to the same one
  if (options.max_seconds > 0 || result.status != Status::tolerance_not_met || events.reason.rfind(out_of_work, 0) != 0)
    return result;
  events = by_events(patient_events);
  return events.status == Status::solved ? events : result;
}

}  // namespace bromwich

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
  first_order.kernel += "; the methods of second order end with: " + result.reason;
  return first_order;
}

}  // namespace

Result solve_by_events(const Scene& given, Backend& backend, const InnerOptions& options) {
  return solve_by_events(with_all_breakpoints(given), backend, options, sizes_for(given, options),
                         event_goal(options, patient_events));
}

Result solve_to_tolerance(const Scene& given, Backend& backend, const InnerOptions& asked) {
  InnerOptions options = asked;
  if (!options.prepared) options.prepared = std::make_shared<Prepared>();
  if (!options.family) options.family = std::make_shared<GridFamily>(true);
  Scene own = with_all_breakpoints(given);
  const bool more = own.breakpoints.size() != given.breakpoints.size();
  own.breakpoints_are_all = more || given.breakpoints_are_all;
  const Scene& scene = more || !options.prepared->stated ? own : given;
  if (options.method != Method::automatic || !unsuited_to_events(scene).empty())
    return by_grids(scene, backend, options);
  const auto by_events = [&](double most_work) {
    return try_events(scene, backend, options, sizes_for(scene, options), event_goal(options, most_work));
  };
  const double quick = quick_events(scene);
  EventAttempt events = by_events(quick);
  const auto ended_by = [&events](NoticeCode code) { return events.cause && events.cause->code == code; };
  if (ended_by(NoticeCode::too_many_steps) && reached(events.result) >= worth_going_on)
    events = by_events(1.25 / worth_going_on * quick);
  if (events.result.status == Status::solved || events.result.status == Status::interrupted) return events.result;
  Result result = by_grids(scene, backend, options);
  if (result.status == Status::solved && ended_by(NoticeCode::other_state))
    tell(result, *events.cause);  // grids go to one of them, and may all go to the same one
  if (options.max_seconds > 0 || result.status != Status::tolerance_not_met || !ended_by(NoticeCode::too_many_steps))
    return result;
  events = by_events(patient_events);
  return events.result.status == Status::solved ? events.result : result;
}

}  // namespace bromwich

#include "core/solve/error_control.hpp"

#include "core/base/error.hpp"
#include "core/events/event_driven.hpp"
#include "core/scene/breakpoints.hpp"
#include "core/solve/error_goal.hpp"
#include "core/solve/event_control.hpp"
#include "core/solve/grid_refinement.hpp"
#include "core/solve/prepared.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

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

// Where no grid was solved by a method of second order.
Result or_by_euler(Result result, const Scene& scene, Backend& backend, const InnerOptions& options) {
  const bool failed = result.status == Status::tolerance_not_met && !result.error_estimate;
  if (options.method != Method::automatic || !failed || scene.boundary) return result;
  note(options.log, LogLevel::info, "no grid is solved by a method of second order: implicit Euler");
  InnerOptions by_euler = options;
  by_euler.method = Method::euler;
  Result first_order = GridRefinement(scene, backend, by_euler, false).run();
  if (first_order.status != Status::solved) return result;
  first_order.kernel += "; the methods of second order end with: " + result.reason;
  return first_order;
}

// Located events and grids, by method automatic or by march alone. Both go on in turn: grids as long as they are
// expected to need fewer operations than the located events still do.
class EventsBesideGrids {
 public:
  EventsBesideGrids(const Scene& scene, Backend& backend, const InnerOptions& options)
      : scene_(scene), backend_(backend), options_(options), grids_(scene, backend, options, false) {}

  Result run() {
    EventGoal goal = event_goal(options_, patient_events);
    goal.budget = [this](double done, double needed) { return allowed(done, needed); };
    EventAttempt events = try_events(scene_, backend_, options_, sizes_for(scene_, options_), goal);
    const bool ended = events.result.status == Status::solved || events.result.status == Status::interrupted;
    if (ended) return std::move(events.result);
    while (!of_grids_) of_grids_ = grids_.advance();
    Result result = or_by_euler(std::move(*of_grids_), scene_, backend_, options_);
    if (options_.method != Method::automatic && result.status != Status::solved)
      result.reason =
          "method events: " + events.result.reason + "; method " + to_string(options_.method) + ": " + result.reason;
    if (result.status == Status::solved && events.cause && events.cause->code == NoticeCode::other_state)
      tell(result, *events.cause);  // grids go to one of them, and may all go to the same one
    return result;
  }

 private:
  static constexpr double more = 1.25;  ///< operations of events before grids may be tried again
  /// Of what events need: the next grid, and a march on steps of their own, which may be in vain. What events need is
  /// not known well near t = 0: the grid takes at most a share of what they have spent, too.
  static constexpr double share = 1.0 / 6, share_of_march = 1.0 / 3, share_of_spent = 0.5;

  double allowed(double done, double needed) {
    if (done < quick_) return quick_;
    note(options_.log, LogLevel::debug, "events: %.2g operations done, about %.2g needed; grids need about %.2g", done,
         needed, grids_.operations_to_goal());
    const auto may_pay = [&] {
      const double next = grids_.operations_of_next();
      return grids_.operations_to_goal() <= needed && next <= share * needed && next <= share_of_spent * done;
    };
    try {
      while (!of_grids_ && !refused_ && may_pay()) of_grids_ = grids_.advance(share_of_march * needed);
    } catch (const Error&) {  // it is thrown again where events do not solve the scene
      refused_ = true;
    }
    return of_grids_ && of_grids_->status == Status::solved ? 0 : more * done;
  }

  const Scene& scene_;
  Backend& backend_;
  const InnerOptions& options_;
  GridRefinement grids_;
  std::optional<Result> of_grids_;
  const double quick_ = quick_events(scene_);  ///< operations of events before grids are tried
  bool refused_ = false;                       ///< the scene, by grids
};

}  // namespace

Result solve_by_events(const Scene& given, Backend& backend, const InnerOptions& options) {
  return solve_by_events(with_all_breakpoints(given), backend, options, sizes_for(given, options),
                         event_goal(options, patient_events));
}

namespace {

Result to_tolerance(const Scene& given, Backend& backend, const InnerOptions& asked, bool beside_events) {
  InnerOptions options = asked;
  if (!options.prepared) options.prepared = std::make_shared<Prepared>();
  if (!options.family) options.family = std::make_shared<GridFamily>(true);
  Scene own = with_all_breakpoints(given);
  const bool more = own.breakpoints.size() != given.breakpoints.size();
  own.breakpoints_are_all = more || given.breakpoints_are_all;
  const Scene& scene = more || !options.prepared->stated ? own : given;
  if (beside_events) return EventsBesideGrids(scene, backend, options).run();
  const bool measures = options.method != Method::automatic;
  return or_by_euler(GridRefinement(scene, backend, options, measures).run(), scene, backend, options);
}

}  // namespace

Result solve_to_tolerance(const Scene& scene, Backend& backend, const InnerOptions& options) {
  return to_tolerance(scene, backend, options,
                      options.method == Method::automatic && unsuited_to_events(scene).empty());
}

Result solve_beside_events(const Scene& scene, Backend& backend, const InnerOptions& options) {
  return to_tolerance(scene, backend, options, true);
}

}  // namespace bromwich

#include "core/solve/shooting_control.hpp"

#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/events/event_sources.hpp"
#include "core/galerkin/checks.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/result/notice.hpp"
#include "core/scene/breakpoints.hpp"
#include "core/shooting/located_shooting.hpp"
#include "core/solve/error_goal.hpp"
#include "core/solve/event_control.hpp"
#include "core/solve/unsolved.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>

namespace bromwich {

namespace {

constexpr std::array<double, 2> shooting_tolerances{1e-10, 1e-12};  ///< of the integrations, see EventOptions
constexpr double most_error = 1e-4;                                 ///< where no tolerance is given

Scene with_start(const Scene& scene, const Vector& x0) {
  Scene started = scene;
  started.boundary.reset();
  started.x0 = x0;
  return started;
}

double residual_of(const BoundaryCondition& c, const Vector& first, const Vector& last) {
  return (c.E0 * first + c.ET * last - c.b).cwiseAbs().maxCoeff<Eigen::PropagateNaN>() /
         std::max(1.0, c.b.cwiseAbs().maxCoeff());
}

ShootingSolution shoot(const Scene& scene, const InnerOptions& options, double tolerance, const Vector& start) {
  ShootingOptions o;
  o.events.tolerance = tolerance;
  o.events.longest_step = longest_step(scene, scene.breakpoints, 1);
  o.events.interrupted = options.interrupted;
  o.start = start;
  return shoot_on_events(scene, selection_class(scene.M, scene.lcp_class), scene.breakpoints, o);
}

void describe(const Scene& scene, const ShootingSolution& s, Result& r) {
  const BoundaryCondition& c = *scene.boundary;
  r.kernel = text("shooting, %ld Newton steps, %ld integrations; ", long(s.newton), long(s.flows)) + r.kernel;
  r.iterations = s.newton;
  r.history = s.history;
  r.start = s.x0;
  if (is_periodic(c)) r.multipliers = multipliers_of(s.D);
  if (!s.determined && r.status == Status::solved) {
    r.well_posed = false;
    tell(r, {NoticeCode::several_starts});
  }
}

}  // namespace

std::string unsuited_to_shooting(const Scene& scene) {
  if (!scene.boundary) return "the scene has initial values";
  Scene started = scene;
  started.boundary.reset();
  return unsuited_to_events(started);
}

Result solve_by_shooting(const Scene& given, Backend& backend, const InnerOptions& options, const Vector& start) {
  Timer timer;
  require_independent_rows(*given.boundary);
  const Scene scene = with_all_breakpoints(given);
  Result result;
  Vector from = start;
  for (const double tolerance : shooting_tolerances) {
    const ShootingSolution s = shoot(scene, options, tolerance, from);
    // One of several periodic states is a result, with a notice. Other conditions that determine nothing are mistakes.
    if (!s.determined && s.free && !(s.found && is_periodic(*scene.boundary))) refuse_open_mode(s.condition);
    if (!s.found) {
      result = unsolved(scene, backend, options, s.interrupted ? Status::interrupted : Status::tolerance_not_met,
                        text("no x(0) was found in %ld integrations: ", long(s.flows)) + s.reason);
      break;
    }
    EventGoal goal = event_goal(options);
    goal.first = tolerance;
    double boundary_residual = NAN;
    goal.error_of_start = [&](const EventSolution& fine) {
      boundary_residual = residual_of(*scene.boundary, s.x0, fine.x(scene.T, true));
      StartError e = error_of_start(scene, s, fine);
      return std::pair(std::move(e.x), std::move(e.y));
    };
    result = solve_by_events(with_start(scene, s.x0), backend, options, sizes_for(given, options), goal);
    describe(scene, s, result);
    result.boundary_residual = boundary_residual;
    if (result.x.cols() == scene.states() && result.x.rows() > 0)
      result.boundary_residual = residual_of(*scene.boundary, s.x0, result.x.bottomRows(1).transpose());
    if (result.status == Status::solved && !controls_error(options) && result.error_estimate > most_error) {
      result.status = Status::tolerance_not_met;
      result.reason =
          text("x(0) was found, and its error and that of the integration are %.1e", *result.error_estimate);
    }
    if (result.status != Status::tolerance_not_met) break;
    from = s.x0;
  }
  result.method = Method::shooting;
  result.seconds.total = result.seconds.solve = result.seconds.other = timer.lap();
  return result;
}

}  // namespace bromwich

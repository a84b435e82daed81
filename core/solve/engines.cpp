#include "core/solve/engines.hpp"

#include "core/base/error.hpp"
#include "core/events/event_driven.hpp"
#include "core/galerkin/galerkin.hpp"
#include "core/goal/goal.hpp"
#include "core/scene/has_impacts.hpp"
#include "core/solve/error_control.hpp"
#include "core/solve/given_steps.hpp"
#include "core/solve/mixed.hpp"
#include "core/solve/reductions.hpp"
#include "core/solve/shooting_control.hpp"
#include "core/solve/unsolved.hpp"

#include <algorithm>
#include <string>

namespace bromwich {

namespace {

// x(0) of method galerkin on the given grid, to start from.
Vector start_by_galerkin(const Scene& scene, Backend& backend, const InnerOptions& options) {
  InnerOptions one = options;
  one.method = Method::galerkin;
  one.states = StateSelection::all;
  one.progress = {};
  try {
    const Result result = solve_by_galerkin(scene, backend, one);
    if (result.status == Status::solved) return result.x.row(0).transpose();
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::bad_input) throw;
  }
  return {};
}

bool ends(const Result& r) { return r.status == Status::solved || r.status == Status::interrupted; }

// Modes with memory are located, as impacts with restitution are: other steps than those of march would take them as
// without.
bool remembers(const Scene& scene) { return !scene.memories.empty(); }
bool is_located(const Scene& scene) { return has_impacts(scene) || remembers(scene); }

// Where it does not succeed from rest, it starts from method galerkin.
Result by_shooting(const Scene& scene, Backend& backend, const InnerOptions& options) {
  Result from_rest = solve_by_shooting(scene, backend, options);
  if (ends(from_rest)) return from_rest;
  if (is_located(scene)) return from_rest;
  const Vector start = start_by_galerkin(scene, backend, options);
  if (start.size() == 0) return from_rest;
  Result again = solve_by_shooting(scene, backend, options, start);
  return ends(again) ? again : from_rest;
}

Result on_grids(const Scene& scene, Backend& backend, const InnerOptions& options) {
  return controls_error(options) ? solve_to_tolerance(scene, backend, options)
                                 : solve_on_steps(scene, backend, options);
}

// Method march with a tolerance, in turn with located events.
Result by_march_and_events(const Scene& scene, Backend& backend, const InnerOptions& options) {
  InnerOptions of_grids = options;
  of_grids.method = Method::march;
  return solve_beside_events(scene, backend, of_grids);
}

Result for_goal(const Scene& scene, Backend& backend, const InnerOptions& options) {
  return solve_for_goal(scene, backend, options);
}

constexpr const char* of_impacts =
    "impacts with restitution are located: use method events or march, or shooting for boundary values";

constexpr const char* of_circles = "friction on circles is taken by method march alone; use it, or facets";

constexpr const char* of_memory = "modes with memory are taken by located events alone; use method events";

std::string not_shooting(const Scene& scene) {
  if (!scene.cones.empty()) return of_circles;
  const std::string why = unsuited_to_shooting(scene);
  if (why.empty()) return "";
  return "method shooting: " + why + (is_located(scene) ? "" : "; use method galerkin");
}

std::string not_events(const Scene& scene) {
  if (!scene.cones.empty()) return of_circles;
  const std::string why = unsuited_to_events(scene);
  return why.empty() ? "" : "method events: " + why + (is_located(scene) ? "" : "; use method march or euler");
}

std::string not_impacts(const Scene& scene) {
  if (!scene.cones.empty()) return of_circles;
  if (has_impacts(scene)) return of_impacts;
  return remembers(scene) ? of_memory : "";
}

std::string not_on_steps(const Scene& scene) {
  if (remembers(scene)) return of_memory;
  if (scene.boundary)
    return "it needs initial values and the scene has boundary values; use method shooting or galerkin";
  if (!scene.free_rows.empty() && !can_eliminate_free(scene))
    return "the free rows and columns of M form a singular matrix; use method galerkin";
  return "";
}

// Of all methods of given steps but march.
std::string not_on_other_steps(const Scene& scene) {
  const std::string why = not_on_steps(scene);
  return why.empty() ? not_impacts(scene) : why;
}

bool never(const Scene&, const InnerOptions&) { return false; }
bool always(const Scene&, const InnerOptions&) { return true; }
// Either may be the faster one: events by their number, march by the tolerance.
bool has_choice(const Scene& scene, const InnerOptions& options) {
  return has_impacts(scene) && !remembers(scene) && !scene.boundary && scene.cones.empty() && controls_error(options) &&
         unsuited_to_events(scene).empty();
}
bool locates(const Scene& scene, const InnerOptions& options) {
  return is_located(scene) && !scene.boundary && !has_choice(scene, options);
}
bool needs_march(const Scene& scene, const InnerOptions& options) {
  return (has_impacts(scene) || !scene.cones.empty()) && !has_choice(scene, options);
}
bool has_boundary(const Scene& scene, const InnerOptions& options) { return scene.boundary && !options.event_location; }

/// Of grids that are tried where method shooting has found no x(0): states that it does not find, unstable ones and
/// those that drift, take seconds on each finer grid and are not found there.
constexpr Index most_after_shooting = 400;

/// One way to solve a scene. Method automatic tries those that want it, in this order, until one solves it.
struct Engine {
  Method method;                                         ///< automatic: all methods of given steps
  bool (*automatic)(const Scene&, const InnerOptions&);  ///< whether that method tries it
  std::string (*why_not)(const Scene&);                  ///< empty: it takes the scene
  Result (*run)(const Scene&, Backend&, const InnerOptions&);
};

constexpr Engine engines[] = {
    {Method::goal, never, not_impacts, for_goal},
    {Method::shooting, has_boundary, not_shooting, by_shooting},
    {Method::galerkin, needs_galerkin, not_impacts, on_grids},
    {Method::events, locates, not_events, solve_by_events},  // others with a tolerance: error_control.cpp
    {Method::events, has_choice, not_events, by_march_and_events},
    {Method::march, needs_march, not_on_steps, on_grids},
    {Method::automatic, always, not_on_other_steps, on_grids},
};

// Where method shooting finds no x(0), grids may; where events are not located, steps over impacts may do.
bool may_be_followed(const Engine& engine, const Scene& scene) {
  return engine.method == Method::shooting || (engine.automatic == locates && !remembers(scene));
}

// Method shooting takes initial values on given steps, as the methods of these do.
bool is_named(const Engine& engine, const Scene& scene, Method method) {
  if (method == Method::automatic || (engine.method == Method::shooting && !scene.boundary)) return false;
  return engine.method == method || engine.method == Method::automatic;
}

}  // namespace

Result solve_reduced(const Scene& scene, Backend& backend, const InnerOptions& options) {
  std::string before;  // why the engines before did not solve it
  bool after_shooting = false;
  std::string refused;
  Result result;
  for (const Engine& engine : engines) {
    const bool named = is_named(engine, scene, options.method);
    if (!named && (options.method != Method::automatic || !engine.automatic(scene, options))) continue;
    if (const std::string why = engine.why_not(scene); !why.empty()) {
      if (named) return unsolved(scene, backend, options, Status::unsupported, why);
      if (refused.empty()) refused = why;
      continue;
    }
    InnerOptions one = options;
    if (!named) one.method = engine.method;
    if (after_shooting) one.max_steps = std::min(one.max_steps, most_after_shooting);
    try {
      Result next = engine.run(scene, backend, one);
      if (!before.empty() && next.status == Status::tolerance_not_met)
        next.reason = before + "; method " + to_string(one.method) + ": " + next.reason;
      if (named || ends(next) || !may_be_followed(engine, scene)) return next;
      result = std::move(next);
    } catch (const Error& error) {
      if (before.empty() || error.kind() != ErrorKind::bad_input) throw;
      result.reason = before + "; method " + to_string(engine.method) + ": " + error.what();
      return result;
    }
    before = std::string("method ") + to_string(engine.method) + ": " + result.reason;
    after_shooting = engine.method == Method::shooting;
    note(options.log, LogLevel::info, "method %s gives up: %s", to_string(engine.method), result.reason.c_str());
  }
  return before.empty() ? unsolved(scene, backend, options, Status::unsupported, refused) : result;
}

}  // namespace bromwich

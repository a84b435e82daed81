#include "core/solve/solve.hpp"

#include "core/base/error.hpp"
#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/result/located.hpp"
#include "core/result/notice.hpp"
#include "core/scene/coarse_sources.hpp"
#include "core/scene/mass_matrix.hpp"
#include "core/solve/engines.hpp"
#include "core/solve/mass_rounding.hpp"
#include "core/solve/methods.hpp"
#include "core/solve/reductions.hpp"
#include "core/solve/unsolved.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <string>
#include <utility>

namespace bromwich {

namespace {

constexpr Index most_steps = Index(1) << 24;
constexpr double most_unresolved = 0.01;  ///< of a source: methods have told of more

void check_event_location(const Scene& scene, const Options& options) {
  if (!options.event_location) return;
  if (controls_error(options)) throw Error("event_location", "found with a tolerance", "give steps instead");
  if (options.method != Method::galerkin && !(options.method == Method::automatic && scene.boundary))
    throw Error("event_location", std::string("found with method ") + to_string(options.method), "use method galerkin");
}

void validate(const Scene& scene, const Options& options) {
  if (options.steps < 0 || options.steps > most_steps)
    throw Error("steps", "found " + std::to_string(options.steps), "give a whole number from 1 to 16777216");
  if (!(options.iteration_tolerance > 0) || !(options.iteration_tolerance < 1))
    throw Error("iteration_tolerance", "found " + std::to_string(options.iteration_tolerance),
                "give a number between 0 and 1");
  for (const auto& [name, value] : {std::pair("tolerance", options.tolerance),
                                    {"tolerance_x", options.tolerance_x},
                                    {"tolerance_y", options.tolerance_y}})
    if (!(value >= 0) || !std::isfinite(value) || (value >= 1 && options.method != Method::goal))
      throw Error(name, text("found %g", value), "give a number between 0 and 1");
  if (!(options.absolute_tolerance >= 0) || !std::isfinite(options.absolute_tolerance))
    throw Error("absolute_tolerance", text("found %g", options.absolute_tolerance), "give a positive number");
  if (options.max_steps < 1 || options.max_steps > most_steps)
    throw Error("max_steps", "found " + std::to_string(options.max_steps), "give a whole number from 1 to 16777216");
  if (!(options.max_seconds >= 0))
    throw Error("max_seconds", text("found %g", options.max_seconds), "give a positive number of seconds");
  if (!(options.tuning.algebraic_share >= 0) || !(options.tuning.algebraic_share < 1))
    throw Error("algebraic_share", "found " + std::to_string(options.tuning.algebraic_share),
                "give a number from 0 to below 1");
  if (!options.confirm && controls_error(options))
    throw Error("confirm", "is false with a tolerance, which compares grids", "give steps in place of the tolerance");
  if (options.max_iterations < 1)
    throw Error("max_iterations", "found " + std::to_string(options.max_iterations), "give at least 1");
  if (options.tuning.literal_nodes < 2 || options.tuning.literal_nodes > 400)
    throw Error("literal_nodes", "found " + std::to_string(options.tuning.literal_nodes), "give 2 to 400");
  for (const Index c : options.components)
    if (c < 0 || c >= scene.states())
      throw Error("states", "component " + std::to_string(c) + " of " + std::to_string(scene.states()),
                  "components are counted from 0");
  check_event_location(scene, options);
}

// Ranks that share the time points run methods over all of them at once, and nothing that depends on a clock.
void validate_ranks(const Scene& scene, const Backend& backend, const Options& options) {
  const int ranks = backend.ranks();
  if (ranks == 1) return;
  const Index steps = steps_of(scene, options);
  if (steps < ranks)
    throw Error("ranks", text("found %d for %ld steps", ranks, long(steps)), "use fewer ranks, or more steps");
  if (options.method != Method::contour && options.method != Method::multigrid && options.method != Method::dual)
    throw Error("method",
                text("found %s on %d ranks, and it does not split over time", to_string(options.method), ranks),
                "choose multigrid, contour or dual, or run it on one rank");
  if (options.max_seconds > 0)
    throw Error("max_seconds", text("is given on %d ranks, whose clocks differ", ranks), "leave it out");
}

// The end of max_seconds, as an interruption.
class Deadline {
 public:
  explicit Deadline(const Options& options) : seconds_(options.max_seconds), asked_(options.interrupted) {}

  bool over() {
    if (asked_ && asked_()) return true;
    if (!late_ && std::chrono::steady_clock::now() - start_ > std::chrono::duration<double>(seconds_)) {
      why_ = text("%.2g s are spent (--max-seconds)", seconds_);
      late_ = true;
    }
    return late_;
  }
  bool late() const { return late_; }
  const std::string& why() const { return why_; }

 private:
  const double seconds_;
  const std::function<bool()> asked_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  bool late_ = false;
  std::string why_ = why_interrupted();
};

Result in_simplest_form(const Scene& scene, Backend& backend, const InnerOptions& options) {
  if (scene.dynamics->has_mass() && scene.dynamics->has_singular_mass())
    return unsolved(scene, backend, options, Status::unsupported, describe_singular_mass(*scene.dynamics));
  const Reductions reduced(scene, options, reductions_of_scene());
  return reduced.of_solve(solve_reduced(reduced.scene(), backend, reduced.options()));
}

Result until_interrupted(const Scene& scene, Backend& backend, InnerOptions options) {
  const auto deadline = std::make_shared<Deadline>(options);
  const bool limited = options.max_seconds > 0 && controls_error(options);
  if (limited) options.interrupted = [deadline] { return deadline->over(); };
  const InterruptedBy polled(options.interrupted, limited ? &deadline->why() : nullptr);
  Result result;
  try {
    result = in_simplest_form(scene, backend, options);
  } catch (const Interrupted&) {
    result = unsolved(scene, backend, options, Status::interrupted, why_interrupted() + " before the first step");
  }
  if (result.status == Status::interrupted && deadline->late()) result.status = Status::tolerance_not_met;
  return result;
}

// Steps that are given may be too few for the sources; with a tolerance and by located events they are chosen.
void report_coarse_sources(const Scene& scene, const Options& options, Result& result) {
  if (controls_error(options) || options.method == Method::goal) return;
  if (locates_switches(result) || result.certificate) return;
  if (result.status != Status::solved || result.unresolved_sources > most_unresolved) return;
  const CoarseSources coarse = find_coarse_sources(scene, result.t);
  if (coarse.missed == 0) return;
  result.unresolved_sources = std::max(result.unresolved_sources, coarse.missed);
  tell_sources(coarse.missed, coarse.time, result);
}

}  // namespace

Result solve_valid(const Scene& scene, Backend& backend, const InnerOptions& options) {
  Timer timer;
  validate(scene, options);
  validate_ranks(scene, backend, options);
  Result result = until_interrupted(scene, backend, options);
  add_rounding_of_mass(scene, backend, options, result);
  report_coarse_sources(scene, options, result);
  const bool replaced = options.method == Method::automatic && result.method == Method::euler;
  if (replaced && result.status == Status::solved) tell(result, {NoticeCode::first_order});
  // What the stages spend beside solves, such as the search for jumps of the sources, belongs to the set-up.
  const double whole = timer.lap();
  result.seconds.setup += std::max(0.0, whole - result.seconds.total);
  result.seconds.total = whole;
  if (!result.warning.empty()) note(options.log, LogLevel::warning, "%s", result.warning.c_str());
  return result;
}

Result solve(const Scene& scene, Backend& backend, const Options& options) {
  Timer timer;
  scene.validate();
  const double looked = timer.lap();
  Result result = solve_valid(scene, backend, InnerOptions{with_defaults(options, scene)});
  result.seconds.setup += looked;
  result.seconds.total += looked;
  return result;
}

}  // namespace bromwich

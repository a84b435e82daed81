#include "core/solve/stages.hpp"

#include "core/accuracy/convergence.hpp"
#include "core/base/error.hpp"
#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/certificate/certificate.hpp"
#include "core/events/event_driven.hpp"
#include "core/galerkin/galerkin.hpp"
#include "core/goal/goal.hpp"
#include "core/scene/breakpoints.hpp"
#include "core/scene/mass_matrix.hpp"
#include "core/scene/port_hamiltonian.hpp"
#include "core/scene/separable.hpp"
#include "core/scene/source_steps.hpp"
#include "core/solve/beside_march.hpp"
#include "core/solve/certification.hpp"
#include "core/solve/cost.hpp"
#include "core/solve/error_control.hpp"
#include "core/solve/mass_rounding.hpp"
#include "core/solve/methods.hpp"
#include "core/solve/mixed.hpp"
#include "core/solve/one_grid.hpp"
#include "core/solve/prepared.hpp"
#include "core/solve/scaling.hpp"
#include "core/solve/shooting_control.hpp"
#include "core/solve/symmetric_form.hpp"
#include "core/solve/unsolved.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <string>

namespace bromwich {

namespace {

constexpr double seen_beside_march = 0.01;  ///< of the mean of y or x: a difference above that is reported
constexpr double seen_in_rows = 0.1;        ///< of y at single time points

void check_event_location(const Scene& scene, const Options& options) {
  if (controls_error(options)) throw Error("event_location", "found with a tolerance", "give steps instead");
  if (options.method != Method::galerkin && !(options.method == Method::automatic && scene.boundary))
    throw Error("event_location", std::string("found with method ") + to_string(options.method), "use method galerkin");
}

// Whether y moves the state, or the state itself, within a part of an interval.
bool has_fast_layers(const Scene& scene, Index J) {
  const DenseDynamics* d = scene.dynamics->small_state();
  return d && !scene.boundary && scene.T / double(J) * d->A.cwiseAbs().rowwise().sum().maxCoeff() > 1;
}

// y is linear inside an interval. Where sources jump or go up and down there (moments follow f and g), or the state is
// faster, method march, which takes such steps in parts or damps them, says how much that matters.
bool compare_with_march(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve& solve,
                        const RowMatrix& x, Result& result) {
  if (!scene.free_rows.empty()) return false;
  const bool layers = result.rough_steps == 0;
  if (layers && !has_fast_layers(scene, result.steps)) return false;
  if (scene.boundary && !Methods::has_small_dense_state(scene)) return false;  // all states are needed in between
  const Result march = beside_march(scene, backend, options, solve, result, x);
  const std::string where = layers ? std::string("the state or y is faster than an interval, in which y is linear")
                                   : text("f or g jumps or changes fast inside %ld of %ld intervals, where y is linear",
                                          long(result.rough_steps), long(result.steps));
  if (march.status == Status::interrupted) return false;
  if (march.status != Status::solved) {
    if (scene.boundary || layers) return false;  // the states of the result need not be those that march allows
    add_warning(result, where + ", and the result could not be compared: method march ends with: " + march.reason);
    return true;
  }
  const Distance d = distance(march, 1, result, 1, ComponentSizes{});
  const double apart = std::max(d.mean, d.of_x());
  if (!layers) result.unresolved_sources = apart;
  if (apart > seen_beside_march)
    add_warning(result, where + text(": method march, which %s, differs by %.0f %%: use more steps, or method march",
                                     layers ? "damps them" : "takes them in parts", 100 * apart));
  else if (!layers && d.y > seen_in_rows)
    add_warning(result, where + text(": beside them y differs from that of method march, which takes them in parts, by "
                                     "up to %.0f %%",
                                     100 * d.y));
  return !layers;
}

// Without such a comparison, g that changes fast is named; jumps that are named have intervals with a rule of their
// own.
void note_fast_g(const Scene& scene, Result& result) {
  if (!scene.g || result.status != Status::solved) return;
  const SampledSource g = sample(scene.g, result.t, scene.constraints());
  const SourceSteps s = find_source_steps(scene, result.t, SampledSource(), g, false);
  if (s.unresolved == 0 && (s.disagreement_of_g == 0 || !scene.breakpoints.empty())) return;
  result.unresolved_sources = std::max(s.disagreement, s.disagreement_of_g);
  result.rough_steps = Index(s.rough.size());
  add_warning(result, text("g changes too fast inside intervals, by up to %.0f %% of its size: use more steps, or "
                           "method march, which takes such steps in parts",
                           100 * result.unresolved_sources));
}

Result by_galerkin(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve& solve) {
  const Index J = steps_of(scene, options);
  const Cost cost = refuse_what_does_not_fit(scene, options, J, Index(recorded_components(scene, options).size()));
  InnerOptions one = options;
  const bool judged = !options.compares_grids && Methods::has_small_dense_state(scene);  // by all states
  if (judged) one.states = StateSelection::all;
  Result result = solve_by_galerkin(scene, backend, one);
  RowMatrix x;
  if (judged) {
    x = std::move(result.x);
    result.x_components = recorded_components(scene, options);
    result.x = x(Eigen::all, result.x_components);
  }
  result.bytes_predicted = std::size_t(cost.bytes);
  const bool alone = !options.event_location && !options.compares_grids && result.status == Status::solved;
  if (alone && options.confirm && !scene.boundary) {
    result.certificate = certify(scene, result, find_breakpoints(scene), x);
    if (result.certificate) {
      take_certificate(result);
      return result;
    }
  }
  if (alone && compare_with_march(scene, backend, options, solve, x, result)) return result;
  if (!options.event_location) note_fast_g(scene, result);
  return result;
}

// f given per state as a few shapes times functions of time: the shapes are columns F, which take the place of one
// column for each state in the shifted solves of large dynamics.
std::optional<Result> columns_of_f(const Scene& scene, Backend& backend, const InnerOptions& options,
                                   const Solve& solve) {
  const SeparableSource* f = scene.f.separable();
  if (!f || scene.f_entry != SourceEntry::state || scene.port) return std::nullopt;
  if (scene.dynamics->small_state() || scene.dynamics->modes()) return std::nullopt;
  Scene same = scene;
  same.F = f->shapes.sparseView(0, 0);
  same.f = f->time;
  same.f_entry = SourceEntry::through_F;
  return solve(same, backend, options);
}

// A regular E: eliminated where that keeps A sparse.
std::optional<Result> mass_matrix(const Scene& scene, Backend& backend, const InnerOptions& options,
                                  const Solve& solve) {
  if (!scene.dynamics->has_mass()) return std::nullopt;
  Timer timer;
  if (!options.units && scene.dynamics->has_singular_mass())
    return unsolved(scene, backend, options, Status::unsupported, describe_singular_mass(*scene.dynamics));
  if (auto reduced = without_mass(scene)) {
    if (options.prepared)
      reduced->dynamics = options.prepared->reduced(Reduction::mass, scene.dynamics, reduced->dynamics);
    note(options.log, LogLevel::debug, "the mass matrix E is eliminated");
    const double spent = timer.lap();
    Result result = solve(*reduced, backend, options);
    add_rounding_of_mass(scene, backend, options, solve, result);
    result.seconds.setup += spent;
    result.seconds.total += spent;
    return result;
  }
  if (options.method != Method::galerkin || !scene.dynamics->has_matrices()) return std::nullopt;
  return solve(written_out(scene), backend, options);  // method galerkin works with dense matrices
}

std::optional<Result> natural_units(const Scene& scene, Backend& backend, const InnerOptions& options,
                                    const Solve& solve) {
  if (options.units) return std::nullopt;
  if (options.event_location) check_event_location(scene, options);
  return solve_in_natural_units(scene, backend, options, solve);
}

std::optional<Result> goal(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve&) {
  if (options.method != Method::goal) return std::nullopt;
  return solve_for_goal(scene, backend, options);
}

std::optional<Result> no_constraints(const Scene& scene, Backend& backend, const InnerOptions& options,
                                     const Solve& solve) {
  if (scene.constraints() > 0) return std::nullopt;
  Result result = solve(with_idle_constraint(scene), backend, options);
  result.y.resize(result.y.rows(), 0);
  result.y_integral.resize(0, 0);
  result.trace.resize(result.trace.rows(), 0);
  return result;
}

// `run` with max_seconds: whatever polls for interruption ends then, the searches of sources among it.
Result within_seconds(const Scene& scene, Backend& backend, const InnerOptions& options,
                      const std::function<Result(const InnerOptions&)>& run) {
  if (!(options.max_seconds > 0) || !controls_error(options)) return run(options);
  const auto late = std::make_shared<std::atomic<bool>>(false);
  const auto start = std::chrono::steady_clock::now();
  InnerOptions limited = options;
  limited.interrupted = [late, start, asked = options.interrupted, seconds = options.max_seconds] {
    if (asked && asked()) return true;
    if (std::chrono::steady_clock::now() - start > std::chrono::duration<double>(seconds)) *late = true;
    return late->load();
  };
  const InterruptedBy polled(limited.interrupted);
  const std::string spent = text("%.2g s are spent (--max-seconds)", options.max_seconds),
                    stopped = "stopped on request";
  Result result;
  try {
    result = run(limited);
  } catch (const Interrupted&) {
    if (!*late) throw;
    return unsolved(scene, backend, options, Status::tolerance_not_met, spent + " before the first step");
  }
  if (result.status != Status::interrupted || !*late) return result;
  result.status = Status::tolerance_not_met;
  if (const std::size_t at = result.reason.find(stopped); at != std::string::npos)
    result.reason.replace(at, stopped.size(), spent);
  else
    result.reason = spent;
  return result;
}

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

// Boundary values by name; automatic tries it. Where it does not succeed from rest, it starts from method galerkin.
// Initial values are a matter of one grid, as those of the other methods.
std::optional<Result> shooting(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve& solve) {
  const bool named = options.method == Method::shooting;
  if (!scene.boundary || (!named && options.method != Method::automatic) || (!named && options.event_location))
    return std::nullopt;
  if (const std::string why = unsuited_to_shooting(scene); !why.empty()) {
    if (!named) return std::nullopt;
    return unsolved(scene, backend, options, Status::unsupported, "method shooting: " + why + "; use method galerkin");
  }
  const auto succeeds = [](const Result& r) { return r.status == Status::solved; };
  Result result = within_seconds(scene, backend, options, [&](const InnerOptions& o) {
    Result from_rest = solve_by_shooting(scene, backend, o);
    if (succeeds(from_rest) || from_rest.status == Status::interrupted) return from_rest;
    const Vector start = start_by_galerkin(scene, backend, o);
    if (start.size() == 0) return from_rest;
    Result again = solve_by_shooting(scene, backend, o, start);
    return succeeds(again) || again.status == Status::interrupted ? again : from_rest;
  });
  if (named || succeeds(result) || result.status == Status::interrupted) return result;
  note(options.log, LogLevel::info, "method shooting gives up: %s", result.reason.c_str());
  InnerOptions by_galerkin = options;
  by_galerkin.method = Method::galerkin;
  try {
    return solve(scene, backend, by_galerkin);
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::bad_input) throw;
    result.reason = "method shooting: " + result.reason + "; method galerkin: " + error.what();
    return result;
  }
}

// Boundary values, and free unknowns that cannot be eliminated.
std::optional<Result> galerkin_alone(const Scene& scene, Backend& backend, const InnerOptions& options,
                                     const Solve& solve) {
  if (options.method == Method::galerkin) return std::nullopt;
  const bool singular = !scene.boundary && !scene.free_rows.empty() && !can_eliminate_free(scene);
  if (!scene.boundary && !singular) return std::nullopt;
  if (options.method != Method::automatic)
    return unsolved(scene, backend, options, Status::unsupported,
                    singular
                        ? "the free rows and columns of M form a singular matrix; use method galerkin"
                        : "it needs initial values and the scene has boundary values; use method shooting or galerkin");
  note(options.log, LogLevel::info, "method galerkin: %s",
       singular ? "the free rows and columns of M form a singular matrix" : "the scene has boundary values");
  InnerOptions named = options;
  named.method = Method::galerkin;
  return solve(scene, backend, named);
}

// By name; automatic tries it for a tolerance.
std::optional<Result> events(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve&) {
  if (options.method != Method::events) return std::nullopt;
  if (const std::string why = unsuited_to_events(scene); !why.empty())
    return unsolved(scene, backend, options, Status::unsupported,
                    "method events: " + why + "; use method march or euler");
  return within_seconds(scene, backend, options,
                        [&](const InnerOptions& o) { return solve_by_events(scene, backend, o); });
}

std::optional<Result> tolerance(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve& solve) {
  if (!controls_error(options)) return std::nullopt;
  return within_seconds(scene, backend, options,
                        [&](const InnerOptions& o) { return solve_to_tolerance(scene, backend, o, solve); });
}

std::optional<Result> galerkin(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve& solve) {
  if (options.method != Method::galerkin) return std::nullopt;
  return by_galerkin(scene, backend, options, solve);
}

std::optional<Result> free_rows(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve& solve) {
  if (scene.free_rows.empty()) return std::nullopt;
  note(options.log, LogLevel::debug, "%zu free rows are eliminated", scene.free_rows.size());
  if (!options.prepared) return solve_mixed(scene, *eliminate_free(scene), backend, options, solve);
  return solve_mixed(scene, *options.prepared->without_free_rows(scene), backend, options, solve);
}

// Below this size dense matrices are faster in everything, and e^{hA} needs no contour.
constexpr Index smallest_sparse = 512;

// With breakpoints a march has steps in parts, and every length of a part needs an exponential of a dense matrix, or a
// factorization of a sparse one. (Whether a sparse march divides its steps is a question for Methods::march.)
constexpr Index smallest_sparse_with_parts = 128;
constexpr double most_filled = 1.0 / 16;  ///< of a matrix that is factorized in much less time

bool stays_sparse(const Scene& scene, Method method) {
  const double m = double(scene.states());
  if (m > double(smallest_sparse)) return true;
  if (scene.breakpoints.empty() || (method != Method::march && method != Method::automatic)) return false;
  return m > double(smallest_sparse_with_parts) &&
         double(scene.dynamics->matrices()->A.nonZeros()) <= most_filled * m * m;
}

std::optional<Result> small_sparse(const Scene& scene, Backend& backend, const InnerOptions& options,
                                   const Solve& solve) {
  if (!scene.dynamics->matrices() || stays_sparse(scene, options.method)) return std::nullopt;
  note(options.log, LogLevel::debug, "sparse dynamics with %ld states are written out as dense ones",
       long(scene.states()));
  Scene dense = written_out(scene);
  if (options.prepared)
    dense.dynamics = options.prepared->reduced(Reduction::written_out, scene.dynamics, dense.dynamics);
  return solve(dense, backend, options);
}

std::optional<Result> one_grid(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve&) {
  return solve_on_one_grid(scene, backend, options);
}

constexpr Stage stages[] = {
    columns_of_f, mass_matrix, solve_in_symmetric_form, natural_units, goal,      no_constraints,
    small_sparse, shooting,    galerkin_alone,          events,        tolerance, galerkin,
    free_rows,    one_grid};

}  // namespace

Result run_stages(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve& solve) {
  for (const Stage stage : stages)
    if (std::optional<Result> result = stage(scene, backend, options, solve)) return std::move(*result);
  return unsolved(scene, backend, options, Status::unsupported, "no stage of the solve takes this scene");
}

}  // namespace bromwich

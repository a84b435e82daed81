#include "core/solve/stages.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/galerkin/galerkin.hpp"
#include "core/goal/goal.hpp"
#include "core/scene/mass_matrix.hpp"
#include "core/scene/port_hamiltonian.hpp"
#include "core/scene/separable.hpp"
#include "core/scene/source_steps.hpp"
#include "core/solve/cost.hpp"
#include "core/solve/error_control.hpp"
#include "core/solve/mixed.hpp"
#include "core/solve/one_grid.hpp"
#include "core/solve/prepared.hpp"
#include "core/solve/scaling.hpp"

#include <algorithm>
#include <string>

namespace bromwich {

Result unsolved(const Scene& scene, const Backend& backend, const Options& options, Status status,
                const std::string& why) {
  Result result;
  result.status = status;
  result.reason = why;
  result.method = options.method;
  result.backend = backend.name();
  result.steps = options.steps > 0 ? options.steps : scene.default_steps;
  result.t = Vector::LinSpaced(result.steps + 1, 0, scene.T);
  result.x_components = recorded_components(scene, options);
  result.y = RowMatrix::Constant(result.steps + 1, scene.constraints(), NAN);
  result.x = RowMatrix::Constant(result.steps + 1, Index(result.x_components.size()), NAN);
  if (options.trace) result.trace = result.y;
  return result;
}

namespace {

void check_event_location(const Scene& scene, const Options& options) {
  if (controls_error(options)) throw Error("event_location", "found with a tolerance", "give steps instead");
  if (options.method != Method::galerkin && !(options.method == Method::automatic && scene.boundary))
    throw Error("event_location", std::string("found with method ") + to_string(options.method), "use method galerkin");
}

// Moments follow f inside an interval. y is linear there, and a g that goes up and down would need more of it; jumps
// that are named have intervals with a rule of their own.
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

Result by_galerkin(const Scene& scene, Backend& backend, const InnerOptions& options) {
  const Index J = options.steps > 0 ? options.steps : scene.default_steps;
  const Cost cost = refuse_what_does_not_fit(scene, options, J, Index(recorded_components(scene, options).size()));
  Result result = solve_by_galerkin(scene, backend, options);
  if (!options.event_location) note_fast_g(scene, result);
  result.bytes_predicted = std::size_t(cost.bytes);
  return result;
}

// A regular E: eliminated where that keeps A sparse.
std::optional<Result> mass_matrix(const Scene& scene, Backend& backend, const InnerOptions& options,
                                  const Solve& solve) {
  if (!scene.dynamics->has_mass()) return std::nullopt;
  Timer timer;
  if (!options.units && scene.dynamics->has_singular_mass())
    return unsolved(scene, backend, options, Status::unsupported,
                    "the mass matrix E is singular: eliminate the algebraic equations, as rows with w = 0 and a free y "
                    "where they are linear");
  if (auto reduced = without_mass(scene)) {
    if (options.prepared)
      reduced->dynamics = options.prepared->reduced(Reduction::mass, scene.dynamics, reduced->dynamics);
    note(options.log, LogLevel::debug, "the mass matrix E is eliminated");
    const double spent = timer.lap();
    Result result = solve(*reduced, backend, options);
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

// Boundary values, and free unknowns that cannot be eliminated.
std::optional<Result> galerkin_alone(const Scene& scene, Backend& backend, const InnerOptions& options,
                                     const Solve& solve) {
  if (options.method == Method::galerkin) return std::nullopt;
  const bool singular = !scene.boundary && !scene.free_rows.empty() && !can_eliminate_free(scene);
  if (!scene.boundary && !singular) return std::nullopt;
  if (options.method != Method::automatic)
    return unsolved(scene, backend, options, Status::unsupported,
                    std::string(singular ? "the free rows and columns of M form a singular matrix"
                                         : "it needs initial values and the scene has boundary values") +
                        "; use method galerkin");
  note(options.log, LogLevel::info, "method galerkin: %s",
       singular ? "the free rows and columns of M form a singular matrix" : "the scene has boundary values");
  InnerOptions named = options;
  named.method = Method::galerkin;
  return solve(scene, backend, named);
}

// By name; automatic tries it for a tolerance.
std::optional<Result> events(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve&) {
  if (options.method != Method::events) return std::nullopt;
  return solve_by_events(scene, backend, options);
}

std::optional<Result> tolerance(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve& solve) {
  if (!controls_error(options)) return std::nullopt;
  return solve_to_tolerance(scene, backend, options, solve);
}

std::optional<Result> galerkin(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve&) {
  if (options.method != Method::galerkin) return std::nullopt;
  return by_galerkin(scene, backend, options);
}

std::optional<Result> free_rows(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve& solve) {
  if (scene.free_rows.empty()) return std::nullopt;
  note(options.log, LogLevel::debug, "%zu free rows are eliminated", scene.free_rows.size());
  if (!options.prepared) return solve_mixed(scene, *eliminate_free(scene), backend, options, solve);
  return solve_mixed(scene, *options.prepared->without_free_rows(scene), backend, options, solve);
}

// Below this size dense matrices are faster in everything, and e^{hA} needs no contour.
constexpr Index smallest_sparse = 512;

std::optional<Result> small_sparse(const Scene& scene, Backend& backend, const InnerOptions& options,
                                   const Solve& solve) {
  if (!scene.dynamics->matrices() || scene.states() > smallest_sparse) return std::nullopt;
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

constexpr Stage stages[] = {mass_matrix, natural_units, goal,     no_constraints, galerkin_alone, small_sparse,
                            events,      tolerance,     galerkin, free_rows,      one_grid};

}  // namespace

Result run_stages(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve& solve) {
  for (const Stage stage : stages)
    if (std::optional<Result> result = stage(scene, backend, options, solve)) return std::move(*result);
  return unsolved(scene, backend, options, Status::unsupported, "no stage of the solve takes this scene");
}

}  // namespace bromwich

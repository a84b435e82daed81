#include "core/galerkin/galerkin.hpp"

#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/galerkin/checks.hpp"
#include "core/galerkin/free.hpp"
#include "core/galerkin/location.hpp"
#include "core/galerkin/recovery.hpp"
#include "core/galerkin/rules.hpp"
#include "core/galerkin/solvers.hpp"
#include "core/kernel/discretise.hpp"
#include "core/march/outcome.hpp"
#include "core/result/notice.hpp"

#include <cmath>

namespace bromwich {

namespace {

constexpr Index most_dense_states = 1024;
constexpr double accepted_residual = 1e-9;
constexpr double delicate_boundary = 1e-7;  ///< reciprocal condition of the boundary problem

bool has_ended(const GalerkinSolution& s) { return s.status != Status::tolerance_not_met; }

// The fast solvers: exchanges or, if they do not end, shooting.
GalerkinSolution exchange_or_shoot(const GalerkinProblem& p, Backend& backend, const Options& options,
                                   const RowMatrix& start) {
  GalerkinSolution exchanged = exchange_active_sets(p, backend, options, &start);
  if (has_ended(exchanged)) return exchanged;
  GalerkinSolution shot = shoot(p, backend, options, galerkin_states(p, start).row(0).transpose());
  return has_ended(shot) ? shot : exchanged;
}

// Boundary values: the fast methods first, then the safe ones. Of several failures the first is the one to explain.
GalerkinSolution solve_boundary_problem(const GalerkinProblem& p, Backend& backend, const Options& options,
                                        const RowMatrix& start) {
  GalerkinSolution first = exchange_or_shoot(p, backend, options, start);
  if (has_ended(first)) return first;
  const Index infeasible = first_infeasible_interval(p, options, first.z, first.x);
  if (infeasible >= 0) {
    first.status = Status::infeasible;
    first.infeasible = infeasible;
    first.reason =
        text("no state and no y satisfy the constraints in the interval that begins at t = %.6g", p.t[infeasible]);
    return first;
  }
  GalerkinSolution damped = damped_newton(p, backend, options, start);
  if (has_ended(damped)) return damped;
  if (p.N * p.unknowns() <= most_assembled) {
    GalerkinSolution pivoted = pivot_assembled(p, options);
    if (has_ended(pivoted)) return pivoted;
  }
  damped.reason = first.reason + "; " + damped.reason;
  return damped;
}

// The same y on twice as many intervals.
RowMatrix halved_intervals(const RowMatrix& z) {
  const Index n = z.cols() / 2;
  RowMatrix fine(2 * z.rows(), z.cols());
  for (Index k = 0; k < z.rows(); ++k) {
    const auto middle = (z.row(k).head(n) + z.row(k).tail(n)) / 2;
    fine.row(2 * k) << z.row(k).head(n), middle;
    fine.row(2 * k + 1) << middle, z.row(k).tail(n);
  }
  return fine;
}

// The active sets of coarser grids: most exchanges happen where they cost little. The safe solvers are for the coarsest
// one, and for the requested grid. If exchanges do not end on a grid in between, the next one begins with empty sets.
RowMatrix nested_start(const Scene& scene, const GalerkinProblem& fine, Index unknowns, Backend& backend,
                       const Options& options, SharedDynamics& shared) {
  constexpr Index fewest_intervals = 32;
  const RowMatrix nothing = RowMatrix::Zero(fine.N, unknowns);
  if (fine.N % 2 != 0 || fine.N / 2 < fewest_intervals) return nothing;
  const GalerkinProblem p = coarser_problem(scene, fine, shared);
  const FreeElimination elimination(p, scene.free_rows);
  const RowMatrix start = nested_start(scene, p, unknowns, backend, options, shared);
  const bool coarsest = p.N % 2 != 0 || p.N / 2 < fewest_intervals;
  const GalerkinSolution s = coarsest ? solve_boundary_problem(elimination.reduced(), backend, options, start)
                                      : exchange_or_shoot(elimination.reduced(), backend, options, start);
  return s.status == Status::solved ? halved_intervals(s.z) : nothing;
}

// All rows are free: the problem is linear.
GalerkinSolution linear_solution(const GalerkinProblem& p) {
  GalerkinSolution s;
  s.status = Status::solved;
  s.how = "linear";
  s.z = RowMatrix(p.N, 0);
  s.x = galerkin_states(p, s.z);
  s.unique = true;
  return s;
}

// `p` is `full` without its free unknowns; `start`: z where the active sets are known about, or null.
GalerkinSolution solved_problem(const Scene& scene, const GalerkinProblem& full, const GalerkinProblem& p,
                                Backend& backend, const Options& options, SharedDynamics& shared,
                                const RowMatrix* start) {
  if (p.unknowns() == 0) return linear_solution(p);
  if (p.initial_value && p.uniform() && !backend.traits().one_at_a_time) {
    GalerkinSolution sweeps = iterate_galerkin(p, backend, options);
    if (sweeps.status == Status::solved || sweeps.status == Status::interrupted) return sweeps;
  }
  if (p.initial_value) return march_galerkin(p, backend, options);
  return solve_boundary_problem(p, backend, options,
                                start ? *start : nested_start(scene, full, p.unknowns(), backend, options, shared));
}

// (J+1) rows: the left end of the first interval, then all right ends.
RowMatrix right_ends(const RowMatrix& z, Index n) {
  RowMatrix y(z.rows() + 1, n);
  y.row(0) = z.row(0).head(n);
  y.bottomRows(z.rows()) = z.rightCols(n);
  return y;
}

void fill(const Scene& scene, const GalerkinProblem& p, const RowMatrix& z, const RowMatrix& x, const Options& options,
          Result& result) {
  const Index n = scene.constraints();
  result.y = right_ends(z, n);
  result.y_left = z.leftCols(n);
  result.x = x(Eigen::all, result.x_components);
  if (options.trace) {
    result.trace.resize(p.N + 1, n);
    for (Index k = 0; k <= p.N; ++k) result.trace.row(k) = observe(scene.dynamics, x.row(k)).transpose();
  }
  if (scene.boundary) {
    const BoundaryCondition& c = p.boundary;
    const Vector apart = c.E0 * x.row(0).transpose() + c.ET * x.row(p.N).transpose() - c.b;
    result.boundary_residual =
        apart.cwiseAbs().maxCoeff<Eigen::PropagateNaN>() / std::max(1.0, c.b.cwiseAbs().maxCoeff());
  }
}

// N x0 + g(0) without rounding, and 0 in free rows, whose w has to be 0 behind t = 0 only.
Vector w_at_start(const Scene& scene, Backend& backend) {
  Vector w = discretise(scene, backend, 1).start;
  w(scene.free_rows).setZero();
  return w;
}

void nothing_found(const Scene& scene, Index N, Result& result) {
  const Index n = scene.constraints();
  result.y = RowMatrix::Constant(N + 1, n, NAN);
  result.y_left = RowMatrix::Constant(N, n, NAN);
  result.x = RowMatrix::Constant(N + 1, Index(result.x_components.size()), NAN);
}

bool finite_galerkin_sources(const GalerkinProblem& p, Result& result) {
  for (const GalerkinRun& run : p.runs)
    if (!run.step.E.allFinite() || !run.step.D.allFinite()) {
      result.status = Status::nonfinite;
      result.reason = text("e^{hA} overflows on an interval of length h = %.6g; take more steps",
                           p.t[run.first + 1] - p.t[run.first]);
      return false;
    }
  for (Index k = 0; k < p.N; ++k) {
    if (p.forcing.row(k).allFinite() && p.q.row(k).allFinite()) continue;
    result.status = Status::nonfinite;
    result.reason = text("f or g is not finite in the interval that begins at t = %.6g", p.t[k]);
    return false;
  }
  return true;
}

// What a solver reports.
void record(const GalerkinSolution& s, const GalerkinProblem& p, Result& result) {
  result.status = s.status;
  result.reason = s.reason;
  result.kernel = "discontinuous piecewise-linear y, exact exponentials; " + s.how;
  result.iterations = s.iterations;
  result.history = s.history;
  if (!s.iterated) result.algebraic_error = 0;
  result.lcp = s.lcp;
  result.seconds.lcp = s.lcp_seconds;
  result.well_posed = s.unique;
  result.bytes = s.bytes + sizeof(double) * std::size_t(3 * p.q.size() + 2 * p.forcing.size());
  if (s.infeasible >= 0) result.infeasible_at = p.t[s.infeasible];
}

// Whether the equations of the free rows can hold; the result says where they contradict each other.
bool free_rows_agree(const FreeElimination& elimination, const GalerkinProblem& p, Result& result) {
  if (const auto k = elimination.contradiction()) {
    result.status = Status::infeasible;
    result.infeasible_at = p.t[*k];
    result.reason = text("the equations of the free rows contradict each other at t = %.6g", *result.infeasible_at);
    return false;
  }
  if (!elimination.unique()) tell(result, {NoticeCode::free_unknowns});
  return true;
}

// Accepts a solution by its residual, and reports that in the units of the user.
void judge(const Scene& scene, const GalerkinProblem& p, const RowMatrix& z, const RowMatrix& x,
           const InnerOptions& options, Result& result) {
  result.residual = natural_residual(p, z, x, scene.free_rows);
  if (result.status == Status::solved && !(result.residual <= accepted_residual)) {
    result.status = Status::tolerance_not_met;
    result.reason = text("the residual is %.1e", result.residual);
  }
  if (options.units && !options.units->trivial())
    result.residual = natural_residual(p, z, x, scene.free_rows, options.units.get());
}

void check_uniqueness(const Scene& scene, Index N, Result& result) {
  const Uniqueness unique = uniqueness_of(scene, N);
  result.well_posed = unique.assured;
  if (!unique.assured) tell(result, {NoticeCode::not_monotone, unique.eigenvalue});
}

// z of known active sets on the parts of a grid, from those of its intervals on coarser grids.
RowMatrix nested_start_on_parts(const Scene& scene, const BrokenGrid& grid, Index unknowns, Backend& backend,
                                const Options& options, SharedDynamics& shared) {
  const GalerkinProblem whole = galerkin_problem(scene, {{scene.T, Index(grid.kept.size()) - 1}}, shared);
  return nested_start(scene, whole, unknowns, backend, options, shared)(grid.of, Eigen::all);
}

// `before`: a result on another grid, or null; `broken`: the intervals that the grid has divided, or null. `shared`:
// what the grids share.
void solve_on_grid(const Scene& scene, Backend& backend, const InnerOptions& options, SharedDynamics& shared,
                   const std::vector<GridPart>& grid, const Result* before, const BrokenGrid* broken, Result& result) {
  Timer timer;
  const GalerkinProblem p = galerkin_problem(scene, grid, shared);
  result.steps = p.N;
  result.t = p.t;
  result.rough_steps = p.divided;
  nothing_found(scene, p.N, result);
  if (!finite_galerkin_sources(p, result)) return;
  if (p.initial_value && starts_below(scene, w_at_start(scene, backend), result)) return;
  const double condition = require_determined_states(p);
  if (condition < delicate_boundary) tell(result, {NoticeCode::boundary, condition});
  const FreeElimination elimination(p, scene.free_rows);
  if (!free_rows_agree(elimination, p, result)) return;
  result.seconds.setup = timer.lap();

  RowMatrix start;
  if (before) start = elimination.bound_part(coefficients_on(*before, p));
  const Index unknowns = elimination.reduced().unknowns();
  if (broken && unknowns > 0) start = nested_start_on_parts(scene, *broken, unknowns, backend, options, shared);
  GalerkinSolution s =
      solved_problem(scene, p, elimination.reduced(), backend, options, shared, before || broken ? &start : nullptr);
  const GalerkinSolver again = [&](const GalerkinProblem& full, const GalerkinProblem& reduced, const RowMatrix& from) {
    return solved_problem(scene, full, reduced, backend, options, shared, &from);
  };
  std::optional<RuledSolution> ruled = solve_by_rules(scene, p, elimination, s, again, options);
  if (ruled) {
    s = std::move(ruled->reduced);
    s.how += describe(ruled->rules);
    result.interval_rules = ruled->rules;
  }
  note(options.log, LogLevel::info, "method galerkin: %ld intervals, %s", long(p.N), s.how.c_str());
  const GalerkinProblem& used = ruled ? *ruled->problem : p;
  const FreeElimination& free = ruled ? *ruled->elimination : elimination;
  record(s, used, result);
  if (s.z.rows() != p.N || s.x.rows() != p.N + 1) return;
  if (!p.initial_value && (s.status == Status::infeasible || !s.z.allFinite())) return;
  const RowMatrix z = free.recovered(s.z, s.x);
  // Those of a march with the y that holds them: what z alone drives would grow away where A is unstable.
  const RowMatrix x = used.initial_value ? s.x : galerkin_states(used, z);
  fill(scene, used, z, x, options, result);
  judge(scene, used, z, x, options, result);
  if (result.status != Status::solved) return;
  if (ruled) result.kernel += described(ruled->rules, p.t);
  if (!s.unique) check_uniqueness(scene, p.N, result);
}

// The same with nodes at the switches and at `breakpoints`, repeated until the switches do not move beyond the accuracy
// of y. False if the result is left as it is.
bool solve_with_located_switches(const Scene& scene, Backend& backend, const InnerOptions& options,
                                 SharedDynamics& shared, const std::vector<double>& breakpoints, Index N,
                                 Result& result) {
  constexpr int most_locations = 5;
  for (int pass = 0; pass < most_locations && result.status == Status::solved; ++pass) {
    const LocatedGrid grid = locate_switches(scene, result, breakpoints, N);
    if (pass > 0 && same_grid(grid.parts, grid_parts(result.t), 0.1 * scene.T / double(N * N))) return true;
    Result located;
    located.method = result.method;
    located.backend = result.backend;
    located.continuous = false;
    located.x_components = result.x_components;
    solve_on_grid(scene, backend, options, shared, grid.parts, &result, nullptr, located);
    if (located.status != Status::solved && located.status != Status::interrupted) {
      note(options.log, LogLevel::info, "with nodes at the switches it is not solved: %s", located.reason.c_str());
      tell(result, {.code = NoticeCode::unlocated_switches, .count = grid.located + grid.missed});
      return pass > 0;
    }
    located.kernel += text("; %ld switches on nodes", long(grid.located));
    if (grid.missed > 0) tell(located, {.code = NoticeCode::unlocated_switches, .count = grid.missed});
    located.seconds = located.seconds + result.seconds;
    located.lcp += result.lcp;
    result = std::move(located);
  }
  return result.status == Status::solved;
}

// Whether intervals are divided at breakpoints: every length has its own phi-functions. Initial values are marched by
// methods that divide their steps.
bool divides_intervals(const Scene& scene, const InnerOptions& options, Index N) {
  constexpr double most_operations = 3e9;
  const double m = double(scene.states()), parts = 2 * double(scene.breakpoints.size());
  return (scene.boundary || options.event_location) && parts > 0 && parts <= 4 * double(N) + 64 &&
         parts * 200 * m * m * m <= most_operations;
}

}  // namespace

Result solve_by_galerkin(const Scene& scene, Backend& backend, const InnerOptions& options) {
  Timer total;
  Result result;
  const Index N = steps_of(scene, options);
  result.method = Method::galerkin;
  result.backend = backend.name();
  result.steps = N;
  result.t = Vector::LinSpaced(N + 1, 0, scene.T);
  result.continuous = false;
  result.x_components = recorded_components(scene, options);
  if (scene.states() > most_dense_states) {
    nothing_found(scene, N, result);
    result.status = Status::unsupported;
    result.reason = text("method galerkin writes the dynamics out densely: %ld states, at most %ld",
                         long(scene.states()), long(most_dense_states));
  } else {
    GridFamily own;
    const std::shared_ptr<SharedDynamics> shared = (options.family ? *options.family : own).of(scene.dynamics);
    const bool divides = divides_intervals(scene, options, N);
    const BrokenGrid broken = divides ? divide_at_breakpoints(scene, N) : BrokenGrid();
    if (broken.divided()) {
      solve_on_grid(scene, backend, options, *shared, broken.parts, nullptr, &broken, result);
    } else {
      solve_on_grid(scene, backend, options, *shared, {{scene.T, N}}, nullptr, nullptr, result);
    }
    const std::vector<double> breakpoints = divides ? scene.breakpoints : std::vector<double>();
    const bool located =
        options.event_location && solve_with_located_switches(scene, backend, options, *shared, breakpoints, N, result);
    if (broken.divided() && !located) keep_nodes(broken, result);
  }
  Seconds& s = result.seconds;
  s.total = total.lap();
  s.solve = s.total - s.setup;
  s.other = std::max(0.0, s.solve - s.lcp);
  return result;
}

}  // namespace bromwich

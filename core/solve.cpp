#include "core/solve.hpp"

#include "core/certification.hpp"
#include "core/cost.hpp"
#include "core/error.hpp"
#include "core/error_control.hpp"
#include "core/galerkin.hpp"
#include "core/goal.hpp"
#include "core/interruption.hpp"
#include "core/method_choice.hpp"
#include "core/mixed.hpp"
#include "core/port_hamiltonian.hpp"
#include "core/scaling.hpp"
#include "core/states.hpp"
#include "core/text.hpp"
#include "core/timer.hpp"
#include "core/windows.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr std::array<std::pair<Method, const char*>, 8> method_names{{
    {Method::automatic, "auto"},
    {Method::multigrid, "multigrid"},
    {Method::contour, "contour"},
    {Method::contour_literal, "contour-literal"},
    {Method::march, "march"},
    {Method::euler, "euler"},
    {Method::galerkin, "galerkin"},
    {Method::goal, "goal"},
}};

constexpr Index most_steps = Index(1) << 24;

void validate(const Scene& scene, const Options& options) {
  if (options.steps < 0 || options.steps > most_steps)
    throw Error("steps", "found " + std::to_string(options.steps), "give a whole number from 1 to 16777216");
  if (!(options.iteration_tolerance > 0) || !(options.iteration_tolerance < 1))
    throw Error("iteration_tolerance", "found " + std::to_string(options.iteration_tolerance),
                "give a number between 0 and 1");
  for (const auto& [name, value] : {std::pair("tolerance", options.tolerance),
                                    {"tolerance_x", options.tolerance_x},
                                    {"tolerance_y", options.tolerance_y}})
    if (!(value >= 0) || !(value < 1)) throw Error(name, text("found %g", value), "give a number between 0 and 1");
  if (!(options.absolute_tolerance >= 0) || !std::isfinite(options.absolute_tolerance))
    throw Error("absolute_tolerance", text("found %g", options.absolute_tolerance), "give a positive number");
  if (options.max_steps < 1 || options.max_steps > most_steps)
    throw Error("max_steps", "found " + std::to_string(options.max_steps), "give a whole number from 1 to 16777216");
  if (!(options.max_seconds >= 0))
    throw Error("max_seconds", text("found %g", options.max_seconds), "give a positive number of seconds");
  if (!(options.algebraic_share >= 0) || !(options.algebraic_share < 1))
    throw Error("algebraic_share", "found " + std::to_string(options.algebraic_share),
                "give a number from 0 to below 1");
  if (options.max_iterations < 1)
    throw Error("max_iterations", "found " + std::to_string(options.max_iterations), "give at least 1");
  if (options.literal_nodes < 2 || options.literal_nodes > 400)
    throw Error("literal_nodes", "found " + std::to_string(options.literal_nodes), "give 2 to 400");
  for (const Index c : options.components)
    if (c < 0 || c >= scene.states())
      throw Error("states", "component " + std::to_string(c) + " of " + std::to_string(scene.states()),
                  "components are counted from 0");
}

// One run of a scene: its methods on the grid asked for, and on finer ones where a result has to be confirmed.
class Run {
 public:
  Run(Methods& methods, Backend& backend, const Options& options)
      : methods_(methods), backend_(backend), options_(options), certification_(methods, backend, options) {}

  void named(Method method, Result& result) {
    methods_.run(method, options_, result);
    if (iterates(method) && result.infeasible_at && result.status == Status::tolerance_not_met)
      confirm_by_marching(result);
    else if (iterates(method) && result.status != Status::infeasible)
      result.infeasible_at.reset();
    if (result.status == Status::infeasible && result.infeasible_at.value_or(0) > 0)
      certification_.confirm_infeasible(result);
    if (result.status == Status::solved) certification_.certify(method, result);
  }

  // What is predicted to be the fastest first. Where it does not fit into memory or ends without a solution (in
  // marching M + W_0 may leave the class of M; the iteration only ever needs M), the next one, and implicit Euler last:
  // not where the steps are too long for a better method, for Euler's result is less exact on that grid.
  void automatic(Result& result) {
    const DiscreteProblem& p = methods_.problem();
    const bool on_device = backend_.device().memory > 0;
    if (!on_device && p.kronecker() && p.scene.constraints() > largest_marched && iterate_first(result)) return;
    std::string before;
    for (const Method method : methods_by_time(p.scene, p.lcp_class, p.J, on_device)) {
      if (method == Method::euler && !options_.fall_back_to_euler) {
        if (result.reason.empty()) result.reason = "no method of second order applies" + before;
        return;
      }
      if (const std::string why = against(method); !why.empty()) {
        before += std::string("; not ") + to_string(method) + ": " + why;
        continue;
      }
      Result next;
      next.seconds.setup = result.seconds.setup;
      const bool stands_in = method == Method::euler && !result.reason.empty();
      const std::string refused = result.reason;
      if (stands_in) certification_.expect_last_resort(result.well_posed);
      named(method, next);
      // Implicit Euler, the last resort, is too inexact to prove that there is no solution where the others did not.
      const bool ended = next.status != Status::tolerance_not_met && next.status != Status::unsupported &&
                         (method != Method::euler || next.status != Status::infeasible);
      const std::string reason = next.reason;
      if (ended || result.reason.empty()) {  // of several failures the first is the one to explain
        result = std::move(next);
        if (ended) result.kernel += before;
        if (ended && stands_in && result.status == Status::solved) say_who_stands_in(refused, result);
      }
      if (ended || certification_.sensitive()) return;
      before += std::string("; not ") + to_string(method) + ": " + reason;
    }
  }

 private:
  static void say_who_stands_in(const std::string& refused, Result& result) {
    add_warning(result, "implicit Euler stands in for a method of higher order, for which " + refused);
  }

  // Above this many constraints the n x n problems of marching cost more than many sweeps; the iteration gets as many
  // as marching is predicted to cost.
  bool iterate_first(Result& result) {
    const DiscreteProblem& p = methods_.problem();
    const double march = predicted_cost(p.scene, Method::march, p.J, 0).operations;
    const double sweep = predicted_cost(p.scene, Method::contour, p.J, 0).operations / 100;
    Options limited = options_;
    limited.max_iterations = std::clamp<Index>(Index(march / sweep), 1, options_.max_iterations);
    Run run(methods_, backend_, limited);
    Result first;
    first.seconds.setup = result.seconds.setup;
    run.named(Method::contour, first);
    if (first.status != Status::solved && first.status != Status::infeasible) return false;
    first.kernel += "; taken before march, whose n x n problems cost more";
    result = std::move(first);
    return true;
  }
  static constexpr Index largest_marched = 1024;

  // What speaks against a method before it runs.
  std::string against(Method method) {
    const DiscreteProblem& p = methods_.problem();
    const DeviceInfo device = backend_.device();
    const Cost cost = predicted_cost(p.scene, method, p.J, Index(p.components.size()), device.threads);
    if (options_.memory_limit > 0 && cost.bytes > options_.memory_limit) return "it does not fit into memory";
    if (!fits_on_device(p.scene, method, p.J, Index(p.components.size()), device))
      return "it does not fit into the memory of the device";
    if (method != Method::contour || p.lcp_class == LcpClass::Z) return "";
    const std::optional<Forecast> f = iteration_forecast(p, options_.iteration_tolerance);
    if (f && f->longest_window(options_.iteration_tolerance) == 0)
      return text("its sweeps are not known to contract (kappa_0 = %.2g)", f->kappa0);
    return "";
  }

  // An infeasible iterate proves nothing about the scene; marching the same discretisation decides.
  void confirm_by_marching(Result& result) {
    const std::string observed = result.reason;
    Result marched;
    methods_.run(Method::march, options_, marched);
    result.infeasible_at.reset();
    if (marched.status == Status::infeasible) {
      result.status = Status::infeasible;
      result.reason = marched.reason + " (confirmed by marching)";
      result.infeasible_at = marched.infeasible_at;
      result.y = std::move(marched.y);
      result.x = std::move(marched.x);
      result.trace = std::move(marched.trace);
      result.residual = marched.residual;
    } else if (marched.status == Status::solved) {
      result.reason = observed + ", but marching gets past it: use method march";
    } else {
      result.reason = observed + "; marching ends too: " + marched.reason;
    }
  }

  Methods& methods_;
  Backend& backend_;
  const Options& options_;
  Certification certification_;
};

bool finite_sources(const DiscreteProblem& p, Result& result) {
  for (const auto& [values, name] : {std::pair(&p.f, "f"), std::pair(&p.g, "g")}) {
    const Index j = values->not_finite();
    if (j < 0) continue;
    result.status = Status::nonfinite;
    result.reason = std::string(name) + " is not finite at t = " + std::to_string(p.t[j]);
    return false;
  }
  return true;
}

}  // namespace

bool controls_error(const Options& o) {
  return o.tolerance > 0 || o.tolerance_x > 0 || o.tolerance_y > 0 || o.absolute_tolerance > 0;
}

const char* to_string(Method method) {
  for (const auto& [value, name] : method_names)
    if (value == method) return name;
  return "unknown";
}

Method method_from_string(const std::string& name) {
  std::string known;
  for (const auto& [value, text] : method_names) {
    if (name == text) return value;
    known += std::string(known.empty() ? "" : ", ") + text;
  }
  throw Error("method", "found '" + name + "'", "use one of " + known);
}

namespace {

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

Result by_galerkin(const Scene& scene, Backend& backend, const Options& options) {
  Options named = options;
  named.method = Method::galerkin;
  const Index J = options.steps > 0 ? options.steps : scene.default_steps;
  const Cost cost = refuse_what_does_not_fit(scene, named, J, Index(recorded_components(scene, options).size()));
  Result result = solve_by_galerkin(scene, backend, named);
  if (!options.event_location) note_fast_g(scene, result);
  result.bytes_predicted = std::size_t(cost.bytes);
  return result;
}

Result unsolved(const Scene& scene, const Backend& backend, const Options& options, Status status,
                const std::string& why) {
  Result result;
  result.status = status;
  result.reason = why;
  result.method = to_string(options.method);
  result.backend = backend.name();
  result.steps = options.steps > 0 ? options.steps : scene.default_steps;
  result.t = Vector::LinSpaced(result.steps + 1, 0, scene.T);
  result.x_components = recorded_components(scene, options);
  result.y = RowMatrix::Constant(result.steps + 1, scene.constraints(), NAN);
  result.x = RowMatrix::Constant(result.steps + 1, Index(result.x_components.size()), NAN);
  if (options.trace) result.trace = result.y;
  return result;
}

Result unsupported(const Scene& scene, const Backend& backend, const Options& options, const std::string& why) {
  return unsolved(scene, backend, options, Status::unsupported, why + "; use method galerkin");
}

void check_event_location(const Scene& scene, const Options& options) {
  if (controls_error(options)) throw Error("event_location", "found with a tolerance", "give steps instead");
  if (options.method != Method::galerkin && !(options.method == Method::automatic && scene.boundary))
    throw Error("event_location", std::string("found with method ") + to_string(options.method), "use method galerkin");
}

// Below this size dense matrices are faster in everything, and e^{hA} needs no contour.
constexpr Index smallest_sparse = 512;

Result solve_valid(const Scene& given, Backend& backend, const Options& options) {
  Timer total;
  if (!options.units) {
    if (options.event_location) check_event_location(given, options);
    return solve_in_natural_units(given, backend, options);
  }
  if (options.method == Method::goal) return solve_for_goal(given, backend, options);
  if (given.constraints() == 0) {
    Result result = solve(with_idle_constraint(given), backend, options);
    result.y.resize(result.y.rows(), 0);
    result.y_integral.resize(0, 0);
    result.trace.resize(result.trace.rows(), 0);
    return result;
  }
  if (options.method == Method::galerkin) return by_galerkin(given, backend, options);
  const bool automatic = options.method == Method::automatic;
  if (given.boundary)
    return automatic
               ? by_galerkin(given, backend, options)
               : unsupported(given, backend, options, "it needs initial values and the scene has boundary values");
  if (!given.free_rows.empty()) {
    if (const auto eliminated = eliminate_free(given))
      return controls_error(options) ? solve_to_tolerance(given, backend, options)  // of all rows
                                     : solve_mixed(given, *eliminated, backend, options);
    return automatic ? by_galerkin(given, backend, options)
                     : unsupported(given, backend, options, "the free rows and columns of M form a singular matrix");
  }
  if (controls_error(options)) return solve_to_tolerance(given, backend, options);
  std::optional<Scene> written_out;
  if (std::holds_alternative<SparseDynamics>(given.dynamics) && given.states() <= smallest_sparse) {
    written_out = given;
    written_out->dynamics = to_dense(given.dynamics);
  }
  const Scene& scene = written_out ? *written_out : given;
  Result result;
  result.method = to_string(options.method);
  const Index J = options.steps > 0 ? options.steps : scene.default_steps;
  if (const RowMatrix* y = options.first_iterate; y && (y->rows() != J + 1 || y->cols() != scene.constraints()))
    throw Error("first_iterate", "found " + std::to_string(y->rows()) + " x " + std::to_string(y->cols()),
                "give one row per time point and one column per constraint");
  const std::vector<Index> components = recorded_components(scene, options);
  const Cost cost = refuse_what_does_not_fit(scene, options, J, Index(components.size()), backend.device());
  Methods methods(scene, backend, J, components, options.look_inside_every_step);
  const DiscreteProblem& p = methods.problem();
  const bool finite = finite_sources(p, result);
  result.seconds.setup = Timer(total).lap();
  if (finite) {
    Run run(methods, backend, options);
    if (options.method == Method::automatic)
      run.automatic(result);
    else
      run.named(options.method, result);
  }
  result.backend = backend.name();
  result.bytes_predicted = std::size_t(cost.bytes);
  result.t = p.t;
  result.steps = J;
  if (result.y.size() == 0) result.y = RowMatrix::Constant(J + 1, scene.constraints(), NAN);
  if (options.trace && result.trace.rows() != J + 1)
    result.trace = RowMatrix::Constant(J + 1, scene.constraints(), NAN);
  if (result.x.rows() != J + 1) result.x = RowMatrix::Constant(J + 1, Index(components.size()), NAN);
  if (result.status == Status::infeasible && result.infeasible_at == 0.0) result.y.setConstant(NAN);
  for (Index j = 0; j < result.trace.rows(); ++j)  // what is not valid of y is not of its trace
    if (!result.y.row(j).allFinite()) result.trace.row(j).setConstant(NAN);
  result.x_components = components;
  Seconds& s = result.seconds;
  s.total = total.lap();
  s.solve = s.total - s.setup;
  s.other = std::max(0.0, s.solve - s.lcp - s.convolution - s.transform);
  return result;
}

}  // namespace

Result solve(const Scene& scene, Backend& backend, const Options& options) {
  scene.validate();
  validate(scene, options);
  const InterruptedBy polled(options.interrupted);
  try {
    return solve_valid(scene, backend, options);
  } catch (const Interrupted&) {
    return unsolved(scene, backend, options, Status::interrupted, "stopped on request before the first step");
  }
}

Matrix states_at(const Scene& scene, Backend& backend, const Result& result, const std::vector<Index>& rows) {
  scene.validate();
  if (result.goal) throw Error("result", "is of method goal", "ask for its states when solving");
  if (scene.constraints() == 0)
    return states_at(with_idle_constraint(scene), backend, with_idle_constraint(result), rows);
  if (result.y.rows() != result.steps + 1 || result.y.cols() != scene.constraints())
    throw Error("result", "its y does not have one row per time point and one column per constraint",
                "pass a result of this scene");
  if (result.method == to_string(Method::euler) || !result.continuous)
    throw Error("result", "its y is not linear between time points", "ask for states when solving");
  if (const auto eliminated = scene.free_rows.empty() ? std::nullopt : eliminate_free(scene))
    return states_at(eliminated->scene, backend, eliminated->reduced(result), rows);
  Index last = 0;
  for (const Index j : rows) {
    if (j < 0 || j > result.steps)
      throw Error("rows", "found " + std::to_string(j), "rows are time points 0.." + std::to_string(result.steps));
    last = std::max(last, j);
  }
  if (!result.y.topRows(last + 1).allFinite())
    throw Error("rows", "the result is not valid up to row " + std::to_string(last), "ask for earlier rows");
  return states_at_rows(discretise(scene, backend, result.steps), result.y, rows, result.defects.get());
}

}  // namespace bromwich

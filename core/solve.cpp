#include "core/solve.hpp"

#include "core/error.hpp"
#include "core/functional_iteration.hpp"
#include "core/lcp.hpp"
#include "core/literal.hpp"
#include "core/marching.hpp"
#include "core/states.hpp"
#include "core/timer.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr std::array<std::pair<Method, const char*>, 5> method_names{{
    {Method::automatic, "auto"},
    {Method::contour, "contour"},
    {Method::contour_literal, "contour-literal"},
    {Method::march, "march"},
    {Method::euler, "euler"},
}};

constexpr Index most_steps = Index(1) << 24;

void validate(const Scene& scene, const Options& options) {
  if (options.steps < 0 || options.steps > most_steps)
    throw Error("steps", "found " + std::to_string(options.steps), "give a whole number from 1 to 16777216");
  if (!(options.iteration_tolerance > 0) || !(options.iteration_tolerance < 1))
    throw Error("iteration_tolerance", "found " + std::to_string(options.iteration_tolerance),
                "give a number between 0 and 1");
  if (options.max_iterations < 1)
    throw Error("max_iterations", "found " + std::to_string(options.max_iterations), "give at least 1");
  if (options.literal_nodes < 2 || options.literal_nodes > 400)
    throw Error("literal_nodes", "found " + std::to_string(options.literal_nodes), "give 2 to 400");
  for (const Index c : options.components)
    if (c < 0 || c >= scene.states())
      throw Error("states", "component " + std::to_string(c) + " of " + std::to_string(scene.states()),
                  "components are counted from 0");
}

// The natural-map residual that a solution may have: rounding of the kernel, and what an iteration tolerance leaves
// open.
double residual_limit(bool iterated, const Options& options) {
  return iterated ? std::clamp(1e3 * options.iteration_tolerance, 1e-9, 1e-2) : 1e-9;
}

// An infeasible iterate proves nothing about the scene; marching the same discretisation decides.
void confirm_infeasible(const DiscreteProblem& p, const Options& options, Result& result) {
  const std::string observed = result.reason;
  Result marched;
  solve_by_marching(p, Rule::exponential, options, marched);
  result.infeasible_at.reset();
  if (marched.status == Status::infeasible) {
    result.status = Status::infeasible;
    result.reason = marched.reason + " (confirmed by marching)";
    result.infeasible_at = marched.infeasible_at;
    result.y = std::move(marched.y);
    result.residual = marched.residual;
  } else if (marched.status == Status::solved) {
    result.reason = observed + ", but marching gets past it: use method march";
  } else {
    result.reason = observed + "; marching ends too: " + marched.reason;
  }
}

// Where M is singular (M = 0 in the extreme) y acts through the state alone, and continuous piecewise-linear y has the
// characteristic root -1: it can alternate from one time point to the next with a perfect residual.
bool can_ring(const DiscreteProblem& p) {
  if (p.lcp_class == LcpClass::P || p.lcp_class == LcpClass::Z) return false;
  const Eigen::FullPivLU<Matrix> lu(to_dense(p.scene.M));
  return !lu.isInvertible();
}

void run(const DiscreteProblem& p, Method method, const Options& options, Result& result) {
  result.method = to_string(method);
  if (method != Method::euler && can_ring(p)) {
    result.status = Status::unsupported;
    result.reason = "M is singular, and piecewise-linear y can ring from one time point to the next; use method euler";
    return;
  }
  switch (method) {
    case Method::contour:
      solve_by_iteration(p, options, result);
      break;
    case Method::contour_literal:
      solve_literally(p, options, result);
      break;
    case Method::euler:
      solve_by_marching(p, Rule::implicit_euler, options, result);
      break;
    default:
      solve_by_marching(p, Rule::exponential, options, result);
      break;
  }
  const bool iterated = method == Method::contour || method == Method::contour_literal;
  if (iterated && result.infeasible_at && result.status == Status::tolerance_not_met)
    confirm_infeasible(p, options, result);
  else if (iterated && result.status != Status::infeasible)
    result.infeasible_at.reset();
  if (result.status == Status::solved && !(result.residual <= residual_limit(iterated, options))) {
    result.status = Status::tolerance_not_met;
    result.reason = "the residual is above the limit for a solution";
  }
}

// On these backends marching with compressed exponentials costs less than a few sweeps of the iteration; where a step
// cannot be solved (M + W_0 may leave the class of M), the iteration only ever needs M.
void run_automatic(const DiscreteProblem& p, const Options& options, Result& result) {
  run(p, Method::march, options, result);
  if (result.status == Status::unsupported) {
    const std::string why = result.reason;
    result.reason.clear();
    run(p, Method::euler, options, result);
    result.kernel += "; march was not used: " + why;
  }
  if (result.status != Status::tolerance_not_met || result.method == to_string(Method::euler)) return;
  Result iterated;
  iterated.seconds.setup = result.seconds.setup;
  run(p, Method::contour, options, iterated);
  if (iterated.status == Status::solved || iterated.status == Status::infeasible) {
    iterated.kernel += "; march was tried first: " + result.reason;
    result = std::move(iterated);
  }
}

bool finite_sources(const DiscreteProblem& p, Result& result) {
  for (const auto& [values, name] : {std::pair(&p.f, "f"), std::pair(&p.g, "g")}) {
    for (Index j = 0; j < values->rows(); ++j) {
      if (values->row(j).allFinite()) continue;
      result.status = Status::nonfinite;
      result.reason = std::string(name) + " is not finite at t = " + std::to_string(p.t[j]);
      return false;
    }
  }
  return true;
}

std::vector<Index> selected(const Scene& scene, const Options& options) {
  if (options.states == StateSelection::list) return options.components;
  std::vector<Index> all(options.states == StateSelection::all ? std::size_t(scene.states()) : 0);
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = Index(i);
  return all;
}

}  // namespace

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

Result solve(const Scene& scene, Backend& backend, const Options& options) {
  Timer total;
  scene.validate();
  validate(scene, options);
  Result result;
  result.method = to_string(options.method);
  const Index J = options.steps > 0 ? options.steps : scene.default_steps;
  const std::vector<Index> components = selected(scene, options);
  const double table = 8.0 * double(J + 1) * double(components.size());
  if (table > 16e9)
    throw Error("states", "the table would take " + std::to_string(long(table / 1e9)) + " GB",
                "ask for fewer components or steps");
  const DiscreteProblem p = discretise(scene, backend, J);
  result.seconds.setup = Timer(total).lap();
  if (finite_sources(p, result)) {
    if (options.method == Method::automatic)
      run_automatic(p, options, result);
    else
      run(p, options.method, options, result);
  }
  result.backend = backend.name();
  result.t = p.t;
  result.steps = J;
  if (result.y.size() == 0) result.y = RowMatrix::Constant(J + 1, scene.constraints(), NAN);
  if (result.status == Status::infeasible && result.infeasible_at == 0.0) result.y.setConstant(NAN);
  result.x_components = components;
  const Rule rule = result.method == to_string(Method::euler) ? Rule::implicit_euler : Rule::exponential;
  result.x = state_components(p, rule, result.y, result.x_components);
  Seconds& s = result.seconds;
  s.total = total.lap();
  s.solve = s.total - s.setup;
  s.other = std::max(0.0, s.solve - s.lcp - s.convolution - s.transform);
  return result;
}

Matrix states_at(const Scene& scene, Backend& backend, const Result& result, const std::vector<Index>& rows) {
  scene.validate();
  if (result.y.rows() != result.steps + 1 || result.y.cols() != scene.constraints())
    throw Error("result", "its y does not have one row per time point and one column per constraint",
                "pass a result of this scene");
  if (result.method == to_string(Method::euler))
    throw Error("result", "it was computed by implicit Euler", "ask for states when solving, or use another method");
  Index last = 0;
  for (const Index j : rows) {
    if (j < 0 || j > result.steps)
      throw Error("rows", "found " + std::to_string(j), "rows are time points 0.." + std::to_string(result.steps));
    last = std::max(last, j);
  }
  if (!result.y.topRows(last + 1).allFinite())
    throw Error("rows", "the result is not valid up to row " + std::to_string(last), "ask for earlier rows");
  return states_at_rows(discretise(scene, backend, result.steps), result.y, rows);
}

}  // namespace bromwich

// symbol  variable            meaning
// t       grid.t              times of the grid, M cells
// x_h     evaluation.x        the solution of the scheme on it
// l       l                   adjoint: S_i^T l_i = R_{i+1}^T l_{i+1} + dI/dx_i
// eta     indicators          contribution of a cell to I(x_h) - I(x)

#include "core/goal/goal.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/goal/complementarity.hpp"
#include "core/goal/cost.hpp"
#include "core/goal/grid_adaptation.hpp"
#include "core/goal/indicators.hpp"
#include "core/kernel/states.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {
namespace {

const char* to_string(AdjointMethod method) {
  switch (method) {
    case AdjointMethod::exact:
      return "exact";
    case AdjointMethod::substitution:
      return "exact (back substitution)";
    case AdjointMethod::jacobi:
      return "block-Jacobi";
    case AdjointMethod::doubling:
      return "exact (doubling)";
    case AdjointMethod::scan:
      break;
  }
  return "exact (scan)";
}

std::string describe(const AdjointChoice& choice) {
  const std::string name = to_string(choice.method);
  return choice.method == AdjointMethod::jacobi
             ? name + text(", %td sweep%s", choice.sweeps, choice.sweeps == 1 ? "" : "s")
             : name;
}

void validate(const GoalOptions& goal, double T) {
  if (!(goal.marking >= 0) || !(goal.marking <= 1))
    throw Error("marking", text("found %g", goal.marking),
                "give a number from 0 to 1; 0 marks the most economical number of cells");
  if (goal.first_cells < 1) throw Error("first_cells", text("found %td", goal.first_cells), "give at least 1");
  if (goal.cycles < 0) throw Error("cycles", text("found %td", goal.cycles), "give 0 or more");
  if (goal.adjoint.method == AdjointMethod::jacobi && goal.adjoint.sweeps < 1)
    throw Error("adjoint", text("%td sweeps", goal.adjoint.sweeps), "give at least 1");
  if (goal.first_grid.size() == 0) return;
  const Vector& t = goal.first_grid;
  if (t.size() < 2 || t[0] != 0 || t[t.size() - 1] != T)
    throw Error("first_grid", text("has %td times", t.size()), text("give times that ascend from 0 to T = %g", T));
  group_steps(t);  // throws if the times do not ascend
}

/// The steps evaluate the input at the right end, in the middle or at both ends. Whether these values are less than a
/// hundredth of those at points in between: a wave that vanishes at all of them, or a pulse.
bool sees_little(const PortSystem& system, StepScheme scheme, const Vector& t) {
  if (!system.port().u) return false;
  const Index M = t.size() - 1;
  const Vector h = t.tail(M) - t.head(M);
  const auto amount = [&](const std::vector<double>& points) {
    double sum = 0;
    for (const double s : points) sum += h.dot(system.inputs(t, s).cwiseAbs().rowwise().sum()) / double(points.size());
    return sum;
  };
  const std::vector<double> looks = scheme == StepScheme::euler      ? std::vector<double>{1}
                                    : scheme == StepScheme::midpoint ? std::vector<double>{0.5}
                                                                     : std::vector<double>{0, 1};
  return amount(looks) < 0.01 * amount({0.1127, 0.3183, 0.7071});
}

}  // namespace

Result solve_for_goal(const Scene& scene, Backend& backend, const Options& options) {
  static const GoalOptions defaults;
  const GoalOptions& goal = options.goal ? *options.goal : defaults;
  if (!scene.port)
    throw Error("method", "goal needs a port-Hamiltonian scene and " + scene.name + " is none",
                "state it by E, J, R, Q, B and u, or use another method");
  if (scene.boundary) throw Error("method", "goal does not support boundary conditions", "use method galerkin");
  validate(goal, scene.T);
  Timer timer;
  PortSystem system(*scene.port, scene.T);
  std::optional<ConstrainedGoal> constrained;
  if (scene.constraints() > 0) constrained.emplace(scene, backend, goal);
  const auto quantity = goal.quantity ? goal.quantity : local_balance();
  const Index first = options.steps > 0 ? std::min(goal.first_cells, options.steps) : goal.first_cells;
  GridBounds bounds;
  bounds.default_cells = scene.default_steps;
  bounds.breaks = input_jumps(*scene.port, scene.T);
  const Vector t = goal.first_grid.size() > 0 ? goal.first_grid : first_grid(scene.T, first, bounds.breaks);
  const auto fits = [&](Index cells, Index sizes) {
    const GoalCost cost = predicted_goal_cost(system, goal.scheme, scene.constraints(), cells, sizes);
    refuse_goal_beyond(options.memory_limit, cost, system, cells, sizes);
    return cost;
  };
  if (options.memory_limit > 0) {
    const Index expected_sizes = 16;
    const Index affordable =
        most_goal_cells(system, goal.scheme, scene.constraints(), expected_sizes, options.memory_limit);
    bounds.memory_bound = affordable < bounds.most_cells;
    bounds.most_cells = std::min(bounds.most_cells, affordable);
    system.memory_limit = std::max(options.memory_limit - fits(std::max(options.steps, first), 1).bytes(), 1.);
    if (constrained) constrained->system().limit_memory(system.memory_limit);
  }
  Result result;
  result.seconds.setup = timer.lap();
  AdaptedGrid grid = adapt_grid(t, options, goal, *quantity, bounds, [&](const Vector& times) {
    fits(times.size() - 1, group_steps(times).sizes.size());
    GoalEvaluation e =
        constrained ? constrained->evaluate(times) : evaluate_goal(system, backend, goal, times, scene.x0);
    e.blind = sees_little(system, goal.scheme, times);
    return e;
  });
  result.seconds.solve = result.seconds.other = timer.lap();
  result.seconds.total = result.seconds.setup + result.seconds.solve;

  const Index M = grid.t.size() - 1;
  GoalReport report{quantity->name(),
                    to_string(goal.scheme),
                    describe(goal.adjoint),
                    to_string(goal.weights),
                    quantity->exact(),
                    grid.history,
                    {},
                    {}};
  report.balance =
      constrained ? constrained->balance(grid) : energy_balance({system, goal.scheme, grid.t, grid.last.x});
  result.status = grid.status;
  result.reason = grid.reason;
  result.method = Method::goal;
  result.backend = backend.name();
  result.kernel = text("%s on %td cells of %td sizes, adjoint %s, %s weights", to_string(goal.scheme), M,
                       grid.last.sizes, report.adjoint.c_str(), to_string(goal.weights));
  if (!grid.last.elsewhere.empty()) result.kernel += ", " + grid.last.elsewhere;
  result.steps = M;
  result.cycles = result.iterations = Index(grid.history.size()) - 1;
  for (const GoalCycle& cycle : grid.history) result.history.push_back(std::abs(cycle.estimate));
  result.y = RowMatrix(M + 1, 0);
  result.residual = 0;  // there are no constraints
  if (grid.last.blind)
    result.warning = text("the input nearly vanishes at all points at which %td steps evaluate it: use other steps", M);
  if (constrained) constrained->report(grid, result);
  report.power =
      constrained ? constrained->power(grid, result) : power_balance({system, goal.scheme, grid.t, grid.last.x});
  result.x_components = recorded_components(scene, options);
  result.x.resize(M + 1, Index(result.x_components.size()));
  for (Index c = 0; c < result.x.cols(); ++c) result.x.col(c) = grid.last.x.col(result.x_components[std::size_t(c)]);
  result.t = std::move(grid.t);
  result.bytes = std::size_t(predicted_goal_cost(system, goal.scheme, scene.constraints(), M, grid.last.sizes).bytes());
  result.bytes_predicted = result.bytes;
  result.goal = std::make_shared<const GoalReport>(std::move(report));
  return result;
}

GoalEvaluation evaluate_goal(const PortSystem& system, Backend& backend, const GoalOptions& goal, const Vector& t,
                             const Vector& x0) {
  const auto quantity = goal.quantity ? goal.quantity : local_balance();
  const StepSizes sizes = group_steps(t);
  const auto chain = backend.step_chain(system.step_problem(goal.scheme, sizes));
  GoalEvaluation e;
  e.x = chain->solve(step_sources(system, goal.scheme, t, x0, &backend));
  const Trajectory path{system, goal.scheme, t, e.x, 1, nullptr, &backend};
  e.sizes = sizes.sizes.size();
  if (chain->on_host && backend.fused().step_chain) e.elsewhere = "steps and adjoints on the host";
  const bool weighted_on_this = goal.weights != CellWeights::global;
  QuantityEvaluation quantity_here = quantity->evaluate(path, weighted_on_this);
  e.quantity = quantity_here.value;
  e.rounding = quantity_here.rounding;
  const RowMatrix l =
      weighted_on_this ? chain->solve_transposed(std::move(quantity_here.gradient), goal.adjoint) : RowMatrix();
  e.indicators = goal_indicators(path, backend, *quantity, goal.weights, l, goal.adjoint);
  return e;
}

}  // namespace bromwich

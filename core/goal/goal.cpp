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
#include "core/result/notice.hpp"
#include "core/scene/breakpoints.hpp"

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

constexpr Index expected_sizes = 16;  ///< step sizes of a grid, where its cells are limited by the memory

/// The cycle for one scene: grids, evaluations on them, and the result.
class GoalSolve {
 public:
  GoalSolve(const Scene& scene, Backend& backend, const Options& options, const GoalOptions& goal)
      : scene_(scene),
        backend_(backend),
        options_(options),
        goal_(goal),
        system_(*scene.port, scene.T),
        quantity_(goal.quantity ? goal.quantity : local_balance()) {
    if (scene.constraints() > 0) constrained_.emplace(scene, backend, goal);
  }

  Result run() {
    const Index first = options_.steps > 0 ? std::min(goal_.first_cells, options_.steps) : goal_.first_cells;
    const GridBounds bounds = limit_cells(first);
    const Vector t = goal_.first_grid.size() > 0 ? goal_.first_grid : first_grid(scene_.T, first, bounds.breaks);
    Result result;
    result.seconds.setup = timer_.lap();
    AdaptedGrid grid = adapt_grid(t, options_, goal_, *quantity_, bounds, [&](const Vector& times) {
      refuse_beyond_limit(times.size() - 1, group_steps(times).sizes.size());
      return evaluate(times);
    });
    result.seconds.solve = result.seconds.other = timer_.lap();
    result.seconds.total = result.seconds.setup + result.seconds.solve;
    describe_solve(grid, result);
    result.goal = report(grid, result);
    take_states(std::move(grid), result);
    return result;
  }

 private:
  GoalCost cost(Index cells, Index sizes) const {
    return predicted_goal_cost(system_, goal_.scheme, scene_.constraints(), cells, sizes);
  }
  void refuse_beyond_limit(Index cells, Index sizes) const {
    refuse_goal_beyond(options_.memory_limit, cost(cells, sizes), system_, cells, sizes);
  }

  /// Where sources jump or have a kink: as far as the scene knows, as samples show and, with a tolerance, by the search
  /// of other methods.
  std::vector<double> grid_breaks() const {
    std::vector<double> breaks = options_.tolerance > 0 ? find_breakpoints(scene_) : scene_.breakpoints;
    const std::vector<double> sampled = input_jumps(*scene_.port, scene_.T);
    breaks.insert(breaks.end(), sampled.begin(), sampled.end());
    const std::vector<double> of_quantity = quantity_->breakpoints();
    breaks.insert(breaks.end(), of_quantity.begin(), of_quantity.end());
    std::erase_if(breaks, [this](double t) { return t <= 0 || t >= scene_.T; });
    std::sort(breaks.begin(), breaks.end());
    const double apart = 64 * epsilon * scene_.T;
    const auto same = [apart](double a, double b) { return b - a <= apart; };
    breaks.erase(std::unique(breaks.begin(), breaks.end(), same), breaks.end());
    return breaks;
  }

  /// The limits that follow from the memory: the number of cells, and the bytes for products of steps, which is what
  /// the requested grid leaves.
  GridBounds limit_cells(Index first) {
    GridBounds bounds;
    bounds.default_cells = scene_.steps();
    bounds.breaks = grid_breaks();
    const double limit = options_.memory_limit;
    if (!(limit > 0)) return bounds;
    const Index affordable = most_goal_cells(system_, goal_.scheme, scene_.constraints(), expected_sizes, limit);
    bounds.memory_bound = affordable < bounds.most_cells;
    bounds.most_cells = std::min(bounds.most_cells, affordable);
    const Index cells = std::max(options_.steps, first);
    refuse_beyond_limit(cells, 1);
    system_.memory_limit = std::max(limit - cost(cells, 1).bytes(), 1.);
    if (constrained_) constrained_->system().limit_memory(system_.memory_limit);
    return bounds;
  }

  GoalEvaluation evaluate(const Vector& t) {
    GoalEvaluation e = constrained_ ? constrained_->evaluate(t) : evaluate_goal(system_, backend_, goal_, t, scene_.x0);
    e.blind = sees_little(system_, goal_.scheme, t);
    return e;
  }

  void describe_solve(const AdaptedGrid& grid, Result& result) {
    const Index M = grid.t.size() - 1;
    result.status = grid.status;
    result.reason = grid.reason;
    result.method = Method::goal;
    result.backend = backend_.name();
    result.kernel = text("%s on %td cells of %td sizes, adjoint %s, %s weights", to_string(goal_.scheme), M,
                         grid.last.sizes, describe(goal_.adjoint).c_str(), to_string(goal_.weights));
    if (!grid.last.elsewhere.empty()) result.kernel += ", " + grid.last.elsewhere;
    result.steps = M;
    result.cycles = result.iterations = Index(grid.history.size()) - 1;
    for (const GoalCycle& cycle : grid.history) result.history.push_back(std::abs(cycle.estimate));
    result.y = RowMatrix(M + 1, 0);
    result.residual = 0;  // of no constraints
    if (grid.last.blind) tell(result, {.code = NoticeCode::blind_input, .count = M});
    if (constrained_) constrained_->report(grid, result);
    result.bytes = result.bytes_predicted = std::size_t(cost(M, grid.last.sizes).bytes());
  }

  std::shared_ptr<const GoalReport> report(const AdaptedGrid& grid, const Result& result) const {
    const Trajectory path{system_, goal_.scheme, grid.t, grid.last.x};
    return std::make_shared<const GoalReport>(
        GoalReport{quantity_->name(), to_string(goal_.scheme), describe(goal_.adjoint), to_string(goal_.weights),
                   quantity_->exact(), grid.history, constrained_ ? constrained_->balance(grid) : energy_balance(path),
                   constrained_ ? constrained_->power(grid, result) : power_balance(path)});
  }

  void take_states(AdaptedGrid grid, Result& result) const {
    result.x_components = recorded_components(scene_, options_);
    result.x = grid.last.x(Eigen::all, result.x_components);
    result.t = std::move(grid.t);
  }

  Timer timer_;
  const Scene& scene_;
  Backend& backend_;
  const Options& options_;
  const GoalOptions& goal_;
  PortSystem system_;
  std::shared_ptr<const QuantityOfInterest> quantity_;
  std::optional<ConstrainedGoal> constrained_;
};

}  // namespace

Result solve_for_goal(const Scene& scene, Backend& backend, const Options& options) {
  static const GoalOptions defaults;
  const GoalOptions& goal = options.goal ? *options.goal : defaults;
  if (!scene.port)
    throw Error("method", "goal needs a port-Hamiltonian scene and " + scene.name + " is none",
                "state it by E, J, R, Q, B and u, or use another method");
  if (scene.boundary) throw Error("method", "goal does not support boundary conditions", "use method galerkin");
  validate(goal, scene.T);
  return GoalSolve(scene, backend, options, goal).run();
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

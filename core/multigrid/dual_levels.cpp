#include "core/multigrid/dual_levels.hpp"

#include "core/base/text.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/operators.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace bromwich {

namespace {

constexpr Index fewest_beside = 8;        ///< steps of a coarsest grid that a device marches
constexpr double most_unseen_dual = 0.3;  ///< the smoothing factor bounds what a coarse grid does not see from above

// A step of a march takes as long as several sweeps on a device: the coarsest grid is short.
std::vector<Index> dual_steps(const BackendTraits& traits, Index J) {
  const Index fewest = traits.one_at_a_time ? traits.fewest_steps : std::min(traits.fewest_steps, fewest_beside);
  std::vector<Index> steps{J};
  while (steps.back() % 2 == 0 && steps.back() / 2 >= fewest) steps.push_back(steps.back() / 2);
  return steps;
}

std::unique_ptr<Convolution> convolution_of(Backend& backend, const DualWeights& V, Index n, Index rows) {
  if (V.stage_weights) return backend.stage_convolution(*V.stage_weights, rows);
  if (V.stage_tables) return V.stage_tables->convolution(backend, n, rows);
  if (const LagTable* table = lag_table_of(*V.weights)) return backend.convolution(*table, rows);
  return backend.convolution(std::get<Recurrence>(*V.weights), rows);
}

// Projected sweeps over both stages of all steps, which solve no problems.
class StageSweeps final : public LcpBatch {
 public:
  StageSweeps(Backend& backend, const StageDivisors& divisors) : LcpBatch(false), backend_(backend), d_(divisors) {}
  void submit(const Array& r, const Array& v, Array& y, Index, double) override {
    backend_.sweep_stages(d_, r, v, y);
    report_.count.solved += y.rows() - 1;
  }
  LcpReport finish(const Array&, const Array&, Array&, Index, double) override { return collect(); }
  LcpReport collect() override { return std::exchange(report_, {}); }
  double residual(const Array&, const Array&, const Array&) override { return NAN; }
  std::size_t bytes() const override { return 0; }

 private:
  Backend& backend_;
  StageDivisors d_;
  LcpReport report_;
};

// The sweeps of a grid: one for all, or in turn.
void take_turns(std::vector<std::unique_ptr<LcpBatch>> sweeps, TimeLevel& level) {
  if (sweeps.size() > 1) {
    auto turns = std::make_unique<SweepsInTurn>(std::move(sweeps));
    level.turns = turns.get();
    level.lcp = std::move(turns);
  } else if (sweeps.size() == 1) {
    level.lcp = std::move(sweeps.front());
  }
}

// Weights, plans and arrays of one grid.
std::unique_ptr<TimeLevel> make_dual_level(const DiscreteProblem& p, const DualWeights& V, Index stages,
                                           const LcpMatrix& P, bool coarsest) {
  auto level = std::make_unique<TimeLevel>();
  const Index rows = stages * p.J + 1, n = p.scene.constraints();
  level->steps = p.J;
  level->weights = V.weights;
  level->kernel =
      std::make_shared<SpaceTimeKernel>(p.backend, convolution_of(p.backend, V, n, rows), p.face(), rows, n);
  for (auto* array : {&level->r, &level->y, &level->v, &level->old}) *array = p.backend.array(rows, n);
  level->sweeps = dual_sweeps;
  level->unseen = stages == 2 ? most_unseen_dual : std::min(V.smoothing, most_unseen_dual);
  level->shift = V.shift;
  level->staged = stages == 2;
  std::vector<std::unique_ptr<LcpBatch>> sweeps;
  if (level->staged) {
    for (const StageDivisors& d : V.stage_divisors) sweeps.push_back(std::make_unique<StageSweeps>(p.backend, d));
  } else if (!coarsest) {
    for (const double d : V.shifts.empty() ? std::vector<double>{V.shift} : V.shifts)
      sweeps.push_back(p.backend.shifted_lcp(P, LcpClass::P, d, rows));
  }
  take_turns(std::move(sweeps), *level);
  return level;
}

void prepare_dual_march(const DiscreteProblem& p, const LcpMatrix& P, const std::function<bool()>& interrupted,
                        TimeLevel& level) {
  MarchProblem problem;
  problem.M = &P;
  problem.lcp_class = LcpClass::P;
  problem.recurrence = recurrence_of(*level.weights);
  problem.lags = lag_table_of(*level.weights);
  problem.r = level.r.get();
  if (level.steps > p.backend.traits().unpolled_steps) problem.interrupted = interrupted;
  level.march = p.backend.march(problem, level.steps + 1);
}

// P - P_c as a convolution without memory; nothing if both are zero.
void set_matrix_change(Backend& backend, const LcpMatrix& fine, const LcpMatrix& coarse, Index rows, TimeLevel& level) {
  if (!std::holds_alternative<Matrix>(fine) && !std::holds_alternative<Matrix>(coarse)) return;
  const Index n = size(fine);
  const DenseRecurrence change{Matrix::Zero(1, 1), Matrix::Zero(1, n), Matrix::Zero(1, n), Matrix::Zero(n, 1),
                               to_dense(fine) - to_dense(coarse)};
  level.matrix_change = backend.convolution(Recurrence(change), rows);
  level.matrix_term = backend.array(rows, n);
}

// A grid to make. One that only serves others as a coarse grid has no sources of its own.
struct GridPlan {
  Index steps, stages;
  bool coarsest, has_sources;
};

// The problem of a grid; nothing on the finest one, which has it.
DualLevels::Grid problem_of_grid(TimeOperator& finest, const GridPlan& plan) {
  DualLevels::Grid grid;
  if (plan.steps == finest.problem().J) return grid;
  grid.problem = std::make_unique<DiscreteProblem>(coarser(finest.problem(), plan.steps));
  grid.op = make_time_operator(*grid.problem);
  return grid;
}

// V of each grid, up to the first one that is refused. Where the grids have the fit of the first one in common and need
// nothing else: on all threads.
std::vector<DualChoice> choose_all(TimeOperator& finest, const std::vector<GridPlan>& plan,
                                   const std::vector<DualLevels::Grid>& grids) {
  const DiscreteProblem& p = finest.problem();
  const auto choose = [&](std::size_t l, const DualWeights* finer) {
    return dual_weights(grids[l].problem ? *grids[l].problem : p, plan[l].stages, finer);
  };
  std::vector<DualChoice> all(plan.size());
  all[0] = choose(0, nullptr);
  if (p.modes() && !p.small_state() && all[0].weights)
    share_each(p.backend, Index(plan.size()) - 1, [&](Index i) {
      const std::size_t l = std::size_t(i) + 1;
      all[l] = choose(l, &*all[0].weights);
    });
  else
    for (std::size_t l = 1; l < plan.size() && all[l - 1].weights; ++l) all[l] = choose(l, &*all[l - 1].weights);
  return all;
}

// Ends the plan above the first grid that is refused, whose neighbour is marched then; the reason if that cannot be.
// How far a backend goes down must not decide whether there is a solution.
std::string end_above_refused(const std::vector<DualChoice>& V, std::vector<GridPlan>& plan) {
  const auto refused = std::find_if(V.begin(), V.end(), [](const DualChoice& choice) { return !choice.weights; });
  if (refused == V.end()) return {};
  const auto kept = std::size_t(refused - V.begin());
  const auto related = std::size_t(std::count_if(plan.begin(), plan.end(), [](auto& g) { return g.stages == 2; }));
  if (kept == 0 || kept < 2 * related || plan[kept - 1].steps > most_marched_dual) return refused->refusal;
  plan.resize(kept);
  plan.back().coarsest = true;
  return {};
}

void add_dual_grid(TimeOperator& finest, const GridPlan& plan, DualLevels::Grid grid, DualWeights V, DualLevels& all) {
  TimeOperator& op = grid.op ? *grid.op : finest;
  if (plan.has_sources && !grid.response) grid.response = make_dual_response(op, plan.stages);
  all.row_scale = V.row_scale;
  all.P.push_back(V.P);
  if (all.levels.size() == 0) all.levels.description = V.description;
  all.levels.kernel_error = std::max(all.levels.kernel_error, V.error);
  if (!plan.coarsest && std::isfinite(V.contraction)) all.contraction = std::max(all.contraction, V.contraction);
  all.levels.grids.push_back(make_dual_level(op.problem(), V, plan.stages, all.P.back(), plan.coarsest));
  all.grids.push_back(std::move(grid));
}

// s of all grids, from x0, f and g of the finest problem.
void take_dual_sources(TimeOperator& finest, const Changes& changes, DualLevels& all) {
  Backend& backend = finest.problem().backend;
  for (std::size_t l = 0; l < all.grids.size(); ++l) {
    DualLevels::Grid& grid = all.grids[l];
    TimeLevel& level = all.levels[l];
    if (!grid.response) continue;
    if (grid.problem) {
      DiscreteProblem renewed = coarser(finest.problem(), level.steps);
      grid.problem->g = std::move(renewed.g);
      grid.problem->f = std::move(renewed.f);
      grid.problem->start = std::move(renewed.start);
      grid.op->renew(changes);
    }
    grid.response->respond(changes, *level.v);
    dual_response(backend, all.P[l], *level.kernel, *level.v, *level.old, *level.r);
    if (all.s[l]) backend.inject(*level.r, *all.s[l]);
  }
}

}  // namespace

namespace {

// With stages the grids of implicit Euler follow: the first ones only as coarse grids.
std::vector<GridPlan> plan_grids(const std::vector<Index>& steps, Index stages) {
  std::vector<GridPlan> plan;
  const std::size_t related = stages == 2 ? std::min<std::size_t>(steps.size(), 3) : 0;
  for (std::size_t l = 0; l < related; ++l) plan.push_back({steps[l], 2, false, true});
  for (std::size_t l = 0; l < steps.size(); ++l) plan.push_back({steps[l], 1, l + 1 == steps.size(), l + 1 >= related});
  return plan;
}

// Which grid each asks, which take part in the start, and arrays for the estimates.
void relate_grids(const DiscreteProblem& p, const std::vector<GridPlan>& plan, DualLevels& all) {
  TimeLevels& levels = all.levels;
  const Index n = p.scene.constraints();
  const auto related = std::size_t(std::count_if(plan.begin(), plan.end(), [](auto& g) { return g.stages == 2; }));
  if (related > 0) levels.related = related == 3;
  levels.description += "; grids of ";
  for (std::size_t l = 0; l < levels.size(); ++l) {
    const bool staged = plan[l].stages == 2;
    levels[l].coarse = staged ? l + related : l + 1;
    levels[l].starts = plan[l].has_sources;
    if (const std::size_t c = levels[l].coarse; c < levels.size())
      set_matrix_change(p.backend, all.P[l], all.P[c], levels[c].steps + 1, levels[l]);
    if (l == 1 || l == 2) {
      levels[l].nested = p.backend.array(levels[l].steps + 1, n);
      levels[l].cycles_at_start = 2;
    }
    if (staged && levels[l].nested) levels[l].ends = p.backend.array(levels[l].steps + 1, n);
    if (l >= related) levels.description += (l > related ? ", " : "") + std::to_string(levels[l].steps);
  }
  levels.description += " steps, the last marched";
}

}  // namespace

std::unique_ptr<DualLevels> dual_levels(TimeOperator& op, Index stages, const Options& options) {
  auto all = std::make_unique<DualLevels>();
  const DiscreteProblem& p = op.problem();
  const std::vector<Index> steps = dual_steps(p.backend.traits(), p.J);
  if (steps.back() > most_marched_dual) {
    all->refusal = text("%ld steps have no grid of at most %ld steps below them: use a power of two times fewer",
                        long(p.J), long(most_marched_dual));
    return all;
  }
  std::vector<GridPlan> plan = plan_grids(steps, stages);
  all->stages = stages;
  all->P.reserve(plan.size());
  std::vector<DualLevels::Grid> grids;
  for (const GridPlan& grid : plan) grids.push_back(problem_of_grid(op, grid));
  grids[0].response = make_dual_response(op, stages);
  grids[0].response->prepare();  // beside the fit of V
  std::vector<DualChoice> V = choose_all(op, plan, grids);
  all->refusal = end_above_refused(V, plan);
  if (!all->refusal.empty()) return all;
  for (std::size_t l = 0; l < plan.size(); ++l)
    add_dual_grid(op, plan[l], std::move(grids[l]), std::move(*V[l].weights), *all);
  TimeLevels& levels = all->levels;
  all->s.resize(levels.size());
  for (std::size_t l = 1; l < levels.size(); ++l)
    if (all->grids[l].response) all->s[l] = p.backend.array(levels[l].r->rows(), levels[l].r->cols());
  all->finest = all->grids[0].response.get();
  levels.finest = {levels[0].kernel, levels.description, levels.kernel_error, levels[0].weights};
  levels.description = (stages == 2 ? "cycles in w at the stages of Radau IIA; " : "cycles in w by implicit Euler; ") +
                       levels.description +
                       (all->contraction > 0 ? text("; forecast %.2f a cycle", all->contraction) : "");
  relate_grids(p, plan, *all);
  prepare_dual_march(p, all->P.back(), options.interrupted, *levels.grids.back());
  levels.take_sources = [&op, all = all.get()](const Changes& changes) {
    take_dual_sources(op, changes, *all);
    return all->levels.kernel_error;
  };
  levels.respond = [&backend = p.backend, all = all.get()] {
    for (std::size_t l = 1; l < all->levels.size(); ++l)
      if (all->s[l]) backend.inject(*all->s[l], *all->levels[l].r);
  };
  levels.take_sources({});
  return all;
}

}  // namespace bromwich

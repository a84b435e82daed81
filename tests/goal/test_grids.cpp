// Goal-oriented grids by division into blocks; reports for grids that tell nothing or exceed the memory limit.

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/goal/cost.hpp"
#include "core/goal/goal.hpp"
#include "core/goal/grid_adaptation.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

namespace bromwich {
namespace {

// Two blocks with one to four cells each, eight in total. With q = 1 a block of cost c = (Σ |η|^{1/2})^2 gets cells in
// proportion to √c: from 1 + 1 to 3 + 3.
TEST(GridAdaptation, DividesByShares) {
  const Vector t{{0, 2.5, 5, 7.5, 10}};
  EXPECT_EQ(divided(t, Vector{{4, 4, 4, 4}}, 1, 8, {}), Vector::LinSpaced(9, 0, 10));
  const Vector finer = divided(t, Vector{{1, 1, 9, 9}}, 1, 8, {5.});  // shares 2 : 6
  EXPECT_EQ(finer.size(), 9);
  EXPECT_EQ(finer.head(3), (Vector{{0, 2.5, 5}}));
  EXPECT_EQ(finer[8], 10);
  EXPECT_NEAR(finer[4] - finer[3], 5. / 6, 1e-14);
  EXPECT_EQ(divided(t, Vector::Zero(4), 3, 8, {}), t);
  const Vector jump = divided(t, Vector{{1, 2, 3, 4}}, 3, 11, {1. / 3});
  EXPECT_EQ(jump.size(), 12);
  EXPECT_EQ((jump.array() == 1. / 3).count(), 1);
  EXPECT_GT((jump.tail(11) - jump.head(11)).minCoeff(), 0);
}

// Division does not lose what halving loses within a round of equal cells: at most a few percent worse than equal
// steps, and better once the wave is resolved; few sizes.
TEST(Goal, DividedGridsOfTheLadderKeepUpWithUniformOnes) {
  const Scene scene = make_scene("ladder");
  const PortSystem system(*scene.port, scene.T);
  const auto backend = make_cpu_backend(1);
  for (const auto& [steps, bound] :
       {std::pair(140, 1.1), std::pair(200, 1.1), std::pair(560, 0.9), std::pair(1130, 0.8)}) {
    GoalOptions goal;
    goal.scheme = StepScheme::midpoint;
    goal.refinement = Refinement::division;
    Options options = options_for(Method::goal, steps);
    options.goal = std::make_shared<GoalOptions>(goal);
    const Result result = solve(scene, *backend, options);
    EXPECT_EQ(result.steps, steps);
    const Vector uniform = Vector::LinSpaced(steps + 1, 0, scene.T);
    EXPECT_LT(result.goal->history.back().quantity,
              bound * evaluate_goal(system, *backend, goal, uniform, scene.x0).quantity)
        << steps;
    EXPECT_LE(result.goal->history.back().sizes, 10);
  }
}

// The estimate is rounding: sums of squares of violations of eps times the energies.
TEST(Goal, SaysNoEffectivityOfWhatIsRounding) {
  const Scene scene = make_scene("ph-toy", {{"u", 0}});
  const PortSystem system(*scene.port, scene.T);
  GoalOptions goal;
  goal.scheme = StepScheme::exponential;
  goal.first_cells = 40000;
  Options options = options_for(Method::goal, 40000);
  options.goal = std::make_shared<GoalOptions>(goal);
  const Result r = solve(scene, *make_cpu_backend(1), options);
  const GoalCycle& last = r.goal->history.back();
  EXPECT_LE(last.quantity, 1e-25);
  EXPECT_FALSE(last.effectivity);
}

TEST(Goal, RefusesWhatDoesNotFitTheMemory) {
  const Scene toy = make_scene("ph-toy");
  const PortSystem small(*toy.port, toy.T);
  const auto backend = make_cpu_backend(1);
  const auto tried = [&](double limit, Index steps, double tolerance, AdjointMethod adjoint) {
    GoalOptions goal;
    goal.adjoint.method = adjoint;
    Options options = options_for(Method::goal, steps);
    options.goal = std::make_shared<GoalOptions>(goal);
    options.memory_limit = limit;
    options.tolerance = tolerance;
    std::string found;
    const std::string line = refusal([&] {
      const Result r = solve(toy, *backend, options);
      found = r.status == Status::solved ? "solved" : r.reason;
    });
    return found.empty() ? line : found;
  };
  EXPECT_TRUE(tried(1e6, 100000, 0, {}).starts_with("steps: 100000 of 1 sizes with 3 states would take"));
  EXPECT_EQ(tried(1e6, 100, 0, {}), "solved");
  EXPECT_TRUE(tried(2e5, 0, 1e-9, {}).ends_with("more do not fit the memory"));
  const double barely = predicted_goal_cost(small, StepScheme::euler, 0, 150, 8).bytes() + 500;
  EXPECT_EQ(tried(barely, 150, 0, AdjointMethod::substitution), "solved");
  EXPECT_TRUE(tried(barely, 150, 0, AdjointMethod::doubling).starts_with("adjoint: doubling would take"));
  // The prediction is at least the memory of the chains of both grids.
  const Scene ladder = make_scene("ladder", {{"n", 200}});
  const PortSystem sparse(*ladder.port, ladder.T);
  for (const PortSystem* system : {&sparse, &small}) {
    const StepSizes sizes = group_steps(first_grid(system->T(), 300, {0.77 * system->T()}));
    const double held = double(backend->step_chain(system->step_problem(StepScheme::euler, sizes))->bytes());
    const GoalCost cost = predicted_goal_cost(*system, StepScheme::euler, 0, 301, sizes.sizes.size());
    EXPECT_GE(cost.bytes(), 2 * held);
    EXPECT_LE(cost.steps, 100 * held);
  }
}

}  // namespace
}  // namespace bromwich

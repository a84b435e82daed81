// Goal-oriented time grids: derivatives, indicators, marking, and what the grids achieve.

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/goal/goal.hpp"
#include "core/goal/grid_adaptation.hpp"
#include "core/goal/indicators.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

namespace bromwich {
namespace {

constexpr StepScheme schemes[] = {StepScheme::euler, StepScheme::midpoint, StepScheme::exponential};

struct Toy {
  Scene scene = make_scene("ph-toy");
  PortSystem system{*scene.port, scene.T};
  std::unique_ptr<Backend> backend = make_cpu_backend(1);

  GoalEvaluation evaluate(const Vector& t, const GoalOptions& goal) const {
    return evaluate_goal(system, *backend, goal, t, scene.x0);
  }
  double uniform(Index M, const GoalOptions& goal) const {
    return evaluate(Vector::LinSpaced(M + 1, 0, scene.T), goal).quantity;
  }
};

std::shared_ptr<const QuantityOfInterest> some_user_quantity() {
  UserQuantity q;
  q.density = [](double t, const Vector& x) { return std::sin(x[0]) * (1 + t) + x[1] * x[2]; };
  q.density_gradient = [](double t, const Vector& x) { return Vector{{std::cos(x[0]) * (1 + t), x[2], x[1]}}; };
  q.end = [](double, const Vector& x) { return std::pow(x[2], 3); };
  q.end_gradient = [](double, const Vector& x) { return Vector{{0, 0, 3 * x[2] * x[2]}}; };
  return user_quantity(q);
}

// Central differences with step e: errors e^2 times third derivatives, and rounding eps/e of the value.
TEST(Quantity, DerivativesAreThoseOfDifferences) {
  const Toy toy;
  reference::Random random(1);
  Vector t = Vector::Zero(32);
  for (Index i = 1; i < 32; ++i) t[i] = t[i - 1] + random.uniform(0.1, 1);
  t *= toy.scene.T / t[31];
  const RowMatrix x = random.matrix(32, 3), direction = random.matrix(32, 3);
  for (const auto& quantity : {global_balance(), local_balance(), weighted_balance(10), some_user_quantity()})
    for (const StepScheme scheme : schemes)
      for (const Index per_cell : {1, 2}) {
        const Vector times = per_cell == 1 ? t : Vector(t.head(31));
        const auto value = [&](double s) {
          const RowMatrix moved = (x + s * direction).topRows(times.size());
          return quantity->value({toy.system, scheme, times, moved, per_cell});
        };
        const double e = 1e-5, differences = (value(e) - value(-e)) / (2 * e);
        const RowMatrix at = x.topRows(times.size());
        const RowMatrix gradient = quantity->gradient({toy.system, scheme, times, at, per_cell});
        const double derivative = gradient.cwiseProduct(direction.topRows(times.size())).sum();
        EXPECT_NEAR(differences, derivative, 1e-6 * std::max(1., std::abs(derivative)))
            << quantity->name() << " " << to_string(scheme) << " " << per_cell;
      }
}

TEST(Quantity, RefusesWhatIsIncomplete) {
  EXPECT_TRUE(refusal([] { weighted_balance(-1); }).starts_with("rho: found -1"));
  EXPECT_TRUE(refusal([] { user_quantity({}); }).starts_with("quantity: has neither an integral"));
  UserQuantity q;
  q.end = [](double, const Vector& x) { return x[0]; };
  EXPECT_TRUE(refusal([&] { user_quantity(q); }).starts_with("quantity: has a function without"));
}

// Adjoint identity Σ z_i^T r_i = I'(P x_h) (X_f - P x_h), and the change of the quadrature from x_h to P x_h: sums of
// some hundred terms.
TEST(Indicators, OfTheGlobalAdjointAreTheDerivativeTowardsTheHalvedGrid) {
  const Toy toy;
  const Vector t = first_grid(10, 60, {});
  for (const auto& quantity : {global_balance(), local_balance(), weighted_balance(10), some_user_quantity()})
    for (const StepScheme scheme : schemes) {
      GoalOptions goal;
      goal.scheme = scheme;
      goal.quantity = quantity;
      goal.weights = CellWeights::global;
      const GoalEvaluation e = toy.evaluate(t, goal);
      const Vector fine_times = halved(t);
      const RowMatrix fine = toy.evaluate(fine_times, goal).x;
      const Trajectory path{toy.system, scheme, t, e.x};
      const RowMatrix coarse = prolonged(path);
      const Trajectory transferred{toy.system, scheme, fine_times, coarse, 2};
      const RowMatrix gradient = quantity->gradient(transferred);
      const double missed = quantity->integrals(path).sum() - quantity->integrals(transferred).sum();
      const double towards = gradient.cwiseProduct(fine - coarse).sum();
      const double scale = gradient.norm() * (fine.norm() + coarse.norm());
      const double left = 1 - std::exp2(-order(scheme)), sum = (missed - quantity->secant() * towards) / left;
      EXPECT_NEAR(e.indicators.sum(), sum, 1e-12 * scale) << quantity->name() << " " << to_string(scheme);
    }
}

// Once the grid resolves the solution, the estimate is within 10 % of the error on uniform grids, and within factors
// [0.3, 3] on adapted ones, whose neighbouring cells differ by factors of 2.
TEST(Indicators, EstimateTheErrorOnceResolved) {
  const Toy toy;
  for (const StepScheme scheme : schemes)
    for (const CellWeights weights : {CellWeights::local, CellWeights::global}) {
      GoalOptions goal;
      goal.scheme = scheme;
      goal.weights = weights;
      const GoalEvaluation e = toy.evaluate(Vector::LinSpaced(401, 0, 10), goal);
      EXPECT_NEAR(e.indicators.sum() / e.quantity, 1, 0.1) << to_string(scheme) << " " << to_string(weights);

      Options options = options_for(Method::goal, 800);
      options.goal = std::make_shared<GoalOptions>(goal);
      const auto report = solve(toy.scene, *toy.backend, options).goal;
      for (const GoalCycle& cycle : report->history) {
        if (cycle.cells < 200) continue;
        EXPECT_GE(cycle.effectivity.value(), 0.3) << to_string(scheme) << " " << cycle.cells;
        EXPECT_LE(cycle.effectivity.value(), 3) << to_string(scheme) << " " << cycle.cells;
      }
    }
}

// Input varying within steps. Midpoint: as usual. Exponential: u is taken as linear, order 2 instead of 4, ratio
// (1 - 2^-2)/(1 - 2^-4) = 0.8. Implicit Euler: u at right ends, a different supply on the halved grid.
TEST(Indicators, KnowWhatAnInputWithinStepsLeavesOut) {
  const Scene scene = make_scene("ladder");
  const PortSystem system(*scene.port, scene.T);
  const auto backend = make_cpu_backend(1);
  const Vector t = Vector::LinSpaced(801, 0, scene.T);
  for (const auto& [scheme, loc, glob] :
       {std::tuple(StepScheme::euler, 2.2, 3.), std::tuple(StepScheme::midpoint, 1., 1.),
        std::tuple(StepScheme::exponential, 0.8, 0.8)})
    for (const auto& [quantity, expected] : {std::pair(local_balance(), loc), std::pair(global_balance(), glob)}) {
      GoalOptions goal;
      goal.scheme = scheme;
      goal.quantity = quantity;
      goal.weights = CellWeights::global;
      const GoalEvaluation e = evaluate_goal(system, *backend, goal, t, scene.x0);
      EXPECT_NEAR(e.indicators.sum() / e.quantity / expected, 1, 0.15) << to_string(scheme) << " " << quantity->name();
    }
}

// A quantity without a known value: the estimate against the value on a grid of 2^17 exponential steps, whose own error
// is (1e-4)^4 plus rounding.
TEST(Indicators, EstimateTheErrorOfAUserQuantity) {
  const Toy toy;
  GoalOptions goal;
  goal.quantity = some_user_quantity();
  goal.scheme = StepScheme::exponential;
  const double exact = toy.evaluate(first_grid(10, 8192, {5.}), goal).quantity;
  for (const StepScheme scheme : {StepScheme::euler, StepScheme::midpoint}) {
    goal.scheme = scheme;
    const GoalEvaluation e = toy.evaluate(first_grid(10, 2000, {5.}), goal);
    const double effectivity = e.indicators.sum() / (e.quantity - exact);
    EXPECT_GE(effectivity, 0.3) << to_string(scheme);
    EXPECT_LE(effectivity, 3) << to_string(scheme);
  }
}

TEST(GridAdaptation, PutsBreaksOnTheGrid) {
  EXPECT_EQ(first_grid(10, 4, {}), (Vector{{0, 2.5, 5, 7.5, 10}}));
  EXPECT_EQ(first_grid(10, 4, {5., 6.}), (Vector{{0, 2.5, 5, 6, 7.5, 10}}));
  EXPECT_EQ(first_grid(10, 2, {5. - 1e-15}).size(), 3);
}

TEST(GridAdaptation, MarksTheFewestCells) {
  const Vector eta{{1, -8, 2, 0, 5}};
  EXPECT_EQ(marked_cells(eta, 0.5, 9), (std::vector<Index>{1}));      // 8 of 16
  EXPECT_EQ(marked_cells(eta, 0.51, 9), (std::vector<Index>{1, 4}));  // 13 of 16
  EXPECT_EQ(marked_cells(eta, 1, 9), (std::vector<Index>{0, 1, 2, 4}));
  EXPECT_EQ(marked_cells(eta, 1, 2), (std::vector<Index>{1, 4}));
  EXPECT_TRUE(marked_cells(Vector::Zero(3), 1, 9).empty());
  EXPECT_EQ(economical_cells(Vector{{1, 1, 1, 1}}, 3, 9).size(), 4u);  // all cells or none
  EXPECT_EQ(economical_cells(Vector{{1, -99, 1, 1}}, 3, 9), (std::vector<Index>{1}));
  EXPECT_TRUE(economical_cells(Vector::Zero(3), 3, 9).empty());
  EXPECT_EQ(bisected(Vector{{0, 1, 3}}, {1}), (Vector{{0, 1, 2, 3}}));
}

TEST(Goal, GridsOfTheToyBeatUniformOnesAtEveryNumberOfSteps) {
  const Toy toy;
  for (const StepScheme scheme : schemes) {
    GoalOptions goal;
    goal.scheme = scheme;
    Options options = options_for(Method::goal, 800);
    options.goal = std::make_shared<GoalOptions>(goal);
    const Result result = solve(toy.scene, *toy.backend, options);
    ASSERT_EQ(result.status, Status::solved) << result.reason;
    EXPECT_EQ(result.steps, 800);
    for (const GoalCycle& cycle : result.goal->history) {
      if (cycle.cells > 20) {
        EXPECT_LT(cycle.quantity, toy.uniform(cycle.cells, goal)) << cycle.cells;
      }
    }
  }
}

/// x of the toy scene in closed form: x(t) for u = 0, then from x(5) with u = 10, by exponential steps.
Vector slope_norms(const Toy& toy, const Vector& t) {
  GoalOptions goal;
  goal.scheme = StepScheme::exponential;
  const RowMatrix x = toy.evaluate(t, goal).x;
  return slopes({toy.system, StepScheme::exponential, t, x}, Side::behind).rowwise().norm();
}

// I_loc of implicit Euler is Σ (h^2 |x'|^2 / 2)^2, minimal if h |x'| is equal in all cells. That grid is the bound.
TEST(Goal, EulerGridOfTheToyIsNearTheEquidistributedOne) {
  const Toy toy;
  const GoalOptions goal;
  const Index M = 200;
  Options options = options_for(Method::goal, M);
  const double adapted = solve(toy.scene, *toy.backend, options).goal->history.back().quantity;
  EXPECT_LE(10 * adapted, toy.uniform(M, goal));

  const Vector fine = first_grid(10, 20000, {5.});
  const Vector speed = slope_norms(toy, fine);
  Vector length = Vector::Zero(fine.size());
  for (Index i = 0; i < speed.size(); ++i) length[i + 1] = length[i] + (fine[i + 1] - fine[i]) * speed[i];
  Vector t(M + 1);
  for (Index i = 0, k = 0; i <= M; ++i) {
    const double wanted = length[length.size() - 1] * double(i) / double(M);
    while (k + 1 < length.size() && length[k] < wanted) ++k;
    t[i] = fine[k];
  }
  t[M] = 10;
  const Index jump = std::min_element(t.data(), t.data() + M + 1,
                                      [](double a, double b) { return std::abs(a - 5) < std::abs(b - 5); }) -
                     t.data();
  t[jump] = 5;
  EXPECT_LE(adapted, 2 * toy.evaluate(t, goal).quantity);
}

// J - R1 has undamped modes: the part of the adjoint seen by one block-Jacobi sweep falls with the number of steps, so
// the estimate misses more and more of the error. J - 10 I forgets within a few steps.
TEST(Goal, OneJacobiSweepSaturatesWhereModesAreUndamped) {
  const auto seen = [](double variant, Index M, Index sweeps) {
    const Scene scene = make_scene("ph-toy", {{"variant", variant}});
    const PortSystem system(*scene.port, scene.T);
    const auto backend = make_cpu_backend(1);
    const Vector t = Vector::LinSpaced(M + 1, 0, scene.T);
    const auto chain = backend->step_chain(
        step_chain_problem(StepScheme::euler, system.step_matrix(StepScheme::euler), group_steps(t)));
    const RowMatrix x = chain->solve(step_sources(system, StepScheme::euler, t, scene.x0));
    const RowMatrix q = local_balance()->gradient({system, StepScheme::euler, t, x});
    const RowMatrix exact = chain->solve_transposed(q, {}).bottomRows(M);
    const RowMatrix jacobi = chain->solve_transposed(q, {AdjointMethod::jacobi, sweeps}).bottomRows(M);
    return (jacobi - exact).norm() / exact.norm();
  };
  EXPECT_GT(seen(1, 100, 1), 0.7);
  EXPECT_GT(seen(1, 400, 1), seen(1, 100, 1));
  EXPECT_GT(seen(1, 1600, 1), 0.95);
  EXPECT_LT(seen(3, 100, 1), 0.7);
  EXPECT_LT(seen(3, 100, 8), 0.05);
  EXPECT_LE(seen(1, 100, 101), 1e-13);  // exact once sweeps reach the number of steps
}

// |x'| of the ladder is a forced oscillation: the equidistributed grid is only 2.2 times better than the uniform one,
// and halving cells loses part of that.
TEST(Goal, CyclesOfTheLadderBeatUniformGrids) {
  const Scene scene = make_scene("ladder");
  const PortSystem system(*scene.port, scene.T);
  const auto backend = make_cpu_backend(1);
  for (const auto& [cycles, marking, first] : {std::tuple(20, 0., 20), std::tuple(60, 0.25, 100)}) {
    GoalOptions goal;
    goal.cycles = cycles;
    goal.marking = marking;
    goal.first_cells = first;
    Options options = options_for(Method::goal);
    options.goal = std::make_shared<GoalOptions>(goal);
    const Result result = solve(scene, *backend, options);
    EXPECT_EQ(result.cycles, cycles);
    const Vector uniform = Vector::LinSpaced(result.steps + 1, 0, scene.T);
    EXPECT_LT(result.goal->history.back().quantity, evaluate_goal(system, *backend, goal, uniform, scene.x0).quantity);
  }
}

TEST(Goal, StopsAtATolerance) {
  const Toy toy;
  Options options = options_for(Method::goal);
  options.tolerance = 1e-2;
  const Result reached = solve(toy.scene, *toy.backend, options);
  EXPECT_EQ(reached.status, Status::solved);
  EXPECT_LE(reached.goal->history.back().quantity, 1e-2);
  options.steps = 40;
  const Result missed = solve(toy.scene, *toy.backend, options);
  EXPECT_EQ(missed.status, Status::tolerance_not_met);
  EXPECT_FALSE(missed.reason.empty());
}

// Sparse steps: 301 states. The violation of implicit Euler as above; the requested number of steps, few or many.
TEST(Goal, TakesSparseScenesAndFewSteps) {
  const Scene scene = make_scene("ladder", {{"n", 100}});
  const auto backend = make_cpu_backend(1);
  for (const Index steps : {3, 30}) {
    Options options = options_for(Method::goal, steps);
    options.states = StateSelection::all;
    const Result result = solve(scene, *backend, options);
    EXPECT_EQ(result.steps, steps);
    const SparseMatrix energy = scene.port->energy_matrix();
    const EnergyBalance& b = result.goal->balance;
    const double scale = b.energy.maxCoeff() + b.supplied.cwiseAbs().sum() + b.dissipated.sum();
    for (Index i = 0; i < steps; ++i) {
      const Vector step = (result.x.row(i + 1) - result.x.row(i)).transpose();
      EXPECT_NEAR(b.violation[i], -step.dot(energy * step) / 2, 1e-13 * scale);
    }
  }
}

TEST(Goal, ExactAdjointsGiveTheSameGrid) {
  const Toy toy;
  Options options = options_for(Method::goal, 150);
  const Vector t = solve(toy.scene, *toy.backend, options).t;
  for (const AdjointMethod method : {AdjointMethod::doubling, AdjointMethod::scan}) {
    GoalOptions goal;
    goal.adjoint.method = method;
    options.goal = std::make_shared<GoalOptions>(goal);
    EXPECT_EQ(solve(toy.scene, *toy.backend, options).t, t);
  }
}

TEST(Goal, RefusesBadInput) {
  const Toy toy;
  const auto refused = [&](const Scene& scene, const std::function<void(GoalOptions&)>& spoil) {
    GoalOptions goal;
    spoil(goal);
    Options options = options_for(Method::goal);
    options.goal = std::make_shared<GoalOptions>(goal);
    return refusal([&] { solve(scene, *toy.backend, options); });
  };
  EXPECT_TRUE(refused(make_scene("bridge"), [](auto&) {}).starts_with("method: goal needs a port-Hamiltonian scene"));
  EXPECT_TRUE(refused(toy.scene, [](auto& g) { g.marking = 2; }).starts_with("marking: found 2"));
  EXPECT_TRUE(refused(toy.scene, [](auto& g) { g.first_cells = 0; }).starts_with("first_cells: found 0"));
  EXPECT_TRUE(refused(toy.scene, [](auto& g) {
                g.first_grid = Vector{{0, 3}};
              }).starts_with("first_grid: has 2 times"));
  EXPECT_TRUE(refused(make_scene("ladder", {{"n", 400}}), [](auto& g) {
                g.scheme = StepScheme::exponential;
              }).starts_with("scheme: exponential with 1201 states"));
}

}  // namespace
}  // namespace bromwich

// Goal-oriented grids of scenes with switching: steps, balance, derivatives along the active sets, and the grids found.

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/goal/complementarity.hpp"
#include "core/goal/indicators.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

namespace bromwich {
namespace {

constexpr StepScheme constrained_schemes[] = {StepScheme::euler, StepScheme::midpoint};

/// Two masses (q, p each), coupled by springs and damped, driven by a wave, each with a soft stop:
/// 0 <= y ⊥ gap - q + y/stiffness >= 0, a force -y on p.
Scene two_stops(double stiffness = 30) {
  PortHamiltonian port;
  const auto sparse = [](const Matrix& X) { return SparseMatrix(X.sparseView()); };
  port.J = sparse(Matrix{{0, 0, 1, 0}, {0, 0, 0, 1}, {-1, 0, 0, 0}, {0, -1, 0, 0}});
  port.R = sparse(Matrix{{0, 0, 0, 0}, {0, 0, 0, 0}, {0, 0, 0.2, 0.05}, {0, 0, 0.05, 0.1}});
  port.Q = sparse(Matrix{{3, -1, 0, 0}, {-1, 2, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 0.5}});
  port.B = sparse(Matrix{{0}, {0}, {1}, {0.5}});
  port.u = [](double t, Eigen::Ref<Vector> u) { u[0] = std::sin(2 * t) + 0.3; };
  Scene scene = make_scene(std::move(port), Vector{{0.1, -0.2, 0.3, 0.1}}, 6);
  scene.name = "two-stops";
  auto& d = get<DenseDynamics>(scene.dynamics);
  d.B = Matrix{{0, 0}, {0, 0}, {-1, 0}, {0, -1}};
  d.N = Matrix{{-1, 0, 0, 0}, {0, -1, 0, 0}};
  scene.M = Matrix(Matrix::Identity(2, 2) / stiffness);
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << 0.15, 0.1 + 0.02 * std::cos(t); };
  return scene;
}

Vector uneven_grid(double T, Index M) {
  reference::Random random(9);
  Vector t = Vector::Zero(M + 1);
  for (Index i = 1; i <= M; ++i) t[i] = t[i - 1] + random.uniform(0.3, 1);
  return t * (T / t[M]);
}

struct Setting {
  explicit Setting(Scene s) : scene(std::move(s)), system(scene) {}
  Scene scene;
  ConstrainedSystem system;
  std::unique_ptr<Backend> backend = make_cpu_backend(1);
};

/// The value of a quantity, its gradient if requested, and all modes that occurred.
struct Looked {
  double value = 0;
  RowMatrix gradient;
  std::vector<Index> modes;
};
Looked look(Setting& s, StepScheme scheme, const Vector& t, const RowMatrix& x, const QuantityOfInterest& quantity) {
  Trajectory path{s.system.port(), scheme, t, x};
  const ConstraintPath constraints = constraints_along(s.system, *s.backend, path);
  path.constraints = &constraints;
  Looked looked{quantity.value(path), quantity.gradient(path), {}};
  for (const ConstraintValues& node : constraints.nodes)
    looked.modes.insert(looked.modes.end(), node.modes.begin(), node.modes.end());
  return looked;
}

std::vector<Scene> switching_scenes() { return {two_stops(), make_scene("ladder-diodes")}; }

std::shared_ptr<const QuantityOfInterest> end_state() {
  UserQuantity q;
  q.end = [](double, const Vector& x) { return x[1] + x[0] * x[0]; };
  q.end_gradient = [](double, const Vector& x) {
    Vector g = Vector::Zero(x.size());
    g[0] = 2 * x[0];
    g[1] = 1;
    return g;
  };
  return user_quantity(q);
}

Index switches(const ConstraintValues& path) {
  Index count = 0;
  for (std::size_t i = 1; i < path.modes.size(); ++i) count += path.modes[i] != path.modes[i - 1];
  return count;
}

// The equations of a step, evaluated directly: rounding of terms of the size of x and |A| h x.
TEST(ConstrainedSteps, SolveTheirEquations) {
  for (const Scene& scene : switching_scenes())
    for (const StepScheme scheme : constrained_schemes) {
      Setting s(scene);
      const Vector t = uneven_grid(scene.T, 300);
      const ConstrainedSolution solution = solve_constrained(s.system, scheme, t, scene.x0);
      ASSERT_EQ(solution.unsolved, -1);
      EXPECT_GE(switches(solution.steps), 2) << scene.name;
      const DenseDynamics d = to_dense(scene.dynamics);
      const Matrix M = to_dense(scene.M);
      const Matrix F = Matrix(state_space(*scene.port).F);
      Vector u(1);
      double worst = 0, size = solution.x.cwiseAbs().maxCoeff();
      for (Index i = 0; i < 300; ++i) {
        const double h = t[i + 1] - t[i], t_e = scheme == StepScheme::euler ? t[i + 1] : t[i] + h / 2;
        const Vector a = solution.x.row(i).transpose(), b = solution.x.row(i + 1).transpose();
        const Vector e = scheme == StepScheme::euler ? b : Vector((a + b) / 2), y = solution.steps.y.row(i).transpose();
        scene.port->u(t_e, u);
        const Vector r = a + h * (d.A * e + d.B * y + F * u) - b;
        const Vector w = d.N * e + M * y + s.system.g(t_e);
        worst = std::max(worst, r.cwiseAbs().maxCoeff());
        EXPECT_LE(y.cwiseMin(w).cwiseAbs().maxCoeff(), 1e-13 * std::max(1., size));
      }
      EXPECT_LE(worst, 1e-12 * size) << scene.name;
    }
}

// v = -||x_i - x_{i-1}||^2 / 2 in the norm of Q^T E for Euler; power removed by the constraints counts as supplied.
TEST(ConstrainedBalance, ViolationOfEulerIsTheSquareOfTheStep) {
  for (const Scene& scene : switching_scenes()) {
    Setting s(scene);
    const Vector t = uneven_grid(scene.T, 300);
    const ConstrainedSolution solution = solve_constrained(s.system, StepScheme::euler, t, scene.x0);
    Trajectory path{s.system.port(), StepScheme::euler, t, solution.x};
    const ConstraintPath constraints = constraints_along(s.system, *s.backend, path);
    path.constraints = &constraints;
    const EnergyBalance b = energy_balance(path);
    const RowMatrix step = solution.x.bottomRows(300) - solution.x.topRows(300);
    const Vector expected = -0.5 * (step * s.system.port().energy_matrix()).cwiseProduct(step).rowwise().sum();
    EXPECT_LE((b.violation - expected).cwiseAbs().maxCoeff(), 1e-13 * b.energy.cwiseAbs().maxCoeff()) << scene.name;
  }
}

// y follows x: central differences of the value, y solved again each time; active sets stay the same. v_i changes by e
// times the energy and is about 1e3 times smaller: the error e^2 1e3 is below 1e-8, and so is rounding eps/e 1e3.
TEST(ConstrainedQuantity, DerivativesAreThoseOfDifferences) {
  for (const Scene& scene : switching_scenes())
    for (const StepScheme scheme : constrained_schemes)
      for (const auto& quantity : {local_balance(), global_balance(), weighted_balance(2)}) {
        Setting s(scene);
        const Vector t = uneven_grid(scene.T, 100);
        const RowMatrix x = solve_constrained(s.system, scheme, t, scene.x0).x;
        const double size = x.cwiseAbs().maxCoeff();
        reference::Random random(4);
        const RowMatrix direction = size * random.matrix(x.rows(), x.cols());
        const Looked at = look(s, scheme, t, x, *quantity);
        const double e = 1e-6;
        const Looked up = look(s, scheme, t, x + e * direction, *quantity),
                     down = look(s, scheme, t, x - e * direction, *quantity);
        ASSERT_EQ(up.modes, at.modes);
        ASSERT_EQ(down.modes, at.modes);
        const double derivative = at.gradient.cwiseProduct(direction).sum();
        EXPECT_NEAR((up.value - down.value) / (2 * e), derivative, 1e-6 * std::max(at.value, std::abs(derivative)))
            << scene.name << " " << quantity->name();
      }
}

// The derivative of a quantity of the *solution* with respect to the initial state is l_0, through the chain of active
// sets.
TEST(ConstrainedAdjoint, GivesTheDerivativeToTheInitialState) {
  for (const Scene& scene : switching_scenes())
    for (const StepScheme scheme : constrained_schemes)
      for (const auto& quantity : {local_balance(), end_state()}) {
        Setting s(scene);
        const Vector t = uneven_grid(scene.T, 200);
        const auto solved = [&](const Vector& x0) { return solve_constrained(s.system, scheme, t, x0); };
        const ConstrainedSolution solution = solved(scene.x0);
        const Looked at = look(s, scheme, t, solution.x, *quantity);
        const ConstrainedChain chain = constrained_chain(s.system, scheme, t, scene.x0, solution.steps);
        const auto plan = s.backend->step_chain(chain.problem);
        const double size = solution.x.cwiseAbs().maxCoeff(), e = 1e-5;
        EXPECT_LE((plan->solve(chain.d) - solution.x).cwiseAbs().maxCoeff(), 1e-12 * size);
        const RowMatrix gradient = at.gradient, l = plan->solve_transposed(gradient, {});
        for (const Index k : {0, 1, 3}) {
          Vector direction = Vector::Zero(scene.states());
          direction[k] = size;
          double differences = 0;
          for (const double sign : {1., -1.}) {
            const ConstrainedSolution moved = solved(scene.x0 + sign * e * direction);
            const Looked there = look(s, scheme, t, moved.x, *quantity);
            ASSERT_EQ(moved.steps.modes, solution.steps.modes) << scene.name;
            ASSERT_EQ(there.modes, at.modes) << scene.name;
            differences += sign * there.value / (2 * e);
          }
          const double derivative = l.row(0).dot(direction.transpose());
          EXPECT_NEAR(differences, derivative, 1e-6 * std::max(std::abs(at.value), std::abs(derivative)))
              << scene.name << " " << quantity->name() << " " << k;
        }
        for (const AdjointMethod method : {AdjointMethod::doubling, AdjointMethod::scan})
          EXPECT_LE((plan->solve_transposed(gradient, {method, 1}) - l).cwiseAbs().maxCoeff(),
                    1e-13 * l.cwiseAbs().maxCoeff());
      }
}

// Values at T = 5e-6 from Runge-Kutta between located switches, given to four digits and more.
TEST(ConstrainedSteps, ConvergeToTheReferenceOfTheLadder) {
  Setting s(make_scene("ladder-diodes"));
  const std::vector<Index> which{0, 1, 2, 15};
  const Vector reference{{0.1235472373142, 0.1318413479844, -0.002213773926825, 0.0007106097436654}};
  for (const StepScheme scheme : constrained_schemes) {
    std::vector<double> errors;
    for (const Index M : {4000, 8000, 16000}) {
      const Vector t = Vector::LinSpaced(M + 1, 0, s.scene.T);
      const Vector end = solve_constrained(s.system, scheme, t, s.scene.x0).x.row(M).transpose();
      errors.push_back((end(which) - reference).cwiseAbs().maxCoeff());
    }
    const double expected = std::exp2(order(scheme));
    for (const std::size_t k : {1u, 2u}) EXPECT_NEAR(errors[k - 1] / errors[k], expected, 0.15 * expected);
  }
}

// Stiff stops: the momentum turns within 0.1 of T = 6 at each contact. At its switches Euler's grid has more than twice
// the mean density of steps, and violates the balance less than a tenth as much as equal steps. Midpoint concentrates
// its steps there too.
TEST(ConstrainedGoal, GridFindsTheSwitches) {
  const Scene scene = two_stops(1000);
  Setting s(scene);
  const Vector fine = Vector::LinSpaced(100001, 0, scene.T);
  const ConstraintValues steps = solve_constrained(s.system, StepScheme::midpoint, fine, scene.x0).steps;
  std::vector<double> times;
  for (std::size_t i = 1; i < steps.modes.size(); ++i)
    if (steps.modes[i] != steps.modes[i - 1]) times.push_back(fine[Index(i)]);
  ASSERT_GE(times.size(), 8u);
  for (const StepScheme scheme : constrained_schemes) {
    GoalOptions goal;
    goal.scheme = scheme;
    Options options = options_for(Method::goal, 400);
    options.goal = std::make_shared<GoalOptions>(goal);
    options.states = StateSelection::all;
    const Result adapted = solve(scene, *s.backend, options);
    ASSERT_EQ(adapted.status, Status::solved) << adapted.reason;
    EXPECT_LE(adapted.residual, 1e-12);
    goal.first_grid = Vector::LinSpaced(adapted.steps + 1, 0, scene.T);
    options.goal = std::make_shared<GoalOptions>(goal);
    options.steps = adapted.steps;
    const Result uniform = solve(scene, *s.backend, options);
    ASSERT_EQ(uniform.steps, adapted.steps);
    EXPECT_LE(10 * adapted.goal->history.back().quantity, uniform.goal->history.back().quantity) << to_string(scheme);
    const double width = 0.002 * scene.T;
    double near = 0;
    for (Index i = 0; i < adapted.steps; ++i) {
      const double middle = (adapted.t[i] + adapted.t[i + 1]) / 2;
      near += std::any_of(times.begin(), times.end(), [&](double at) { return std::abs(at - middle) < width; });
    }
    const double share = 2 * width * double(times.size()) / scene.T;  // fraction of the time interval
    EXPECT_GE(near, 2 * share * double(adapted.steps)) << to_string(scheme);
  }
}

// |x'| of the ladder hardly varies: T^3 ∫|x'|^4 / (∫|x'|)^4 = 2.2 bounds the gain of any grid over equal steps for
// Euler, and halving cells can lose a factor of 1.9. The quantity is the sum of (½ ‖x_i - x_{i-1}‖²)² over the states.
TEST(ConstrainedGoal, EstimatesTheBalanceOfTheLadder) {
  const Scene scene = make_scene("ladder-diodes");
  const auto backend = make_cpu_backend(1);
  const auto solved = [&](Index first) {
    GoalOptions goal;
    goal.first_cells = first;
    Options options = options_for(Method::goal, 800);
    options.goal = std::make_shared<GoalOptions>(goal);
    options.states = StateSelection::all;
    return solve(scene, *backend, options);
  };
  const Result result = solved(20), equal = solved(800);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  ASSERT_EQ(result.steps, 800);
  ASSERT_EQ(equal.goal->history.size(), 1u);
  for (const Result* r : {&result, &equal}) {
    const RowMatrix step = r->x.bottomRows(800) - r->x.topRows(800);
    const Vector v = 0.5 * (step * scene.port->energy_matrix()).cwiseProduct(step).rowwise().sum();
    EXPECT_NEAR(r->goal->history.back().quantity / v.squaredNorm(), 1, 1e-9);
  }
  const GoalCycle& last = result.goal->history.back();
  ASSERT_TRUE(last.effectivity);
  EXPECT_GE(*last.effectivity, 0.3);
  EXPECT_LE(*last.effectivity, 3);
  const double gain = equal.goal->history.back().quantity / last.quantity;
  EXPECT_LE(gain, 2.2 * 1.1);  // the bound is asymptotic
  EXPECT_GE(gain, 1 / 1.9);
  EXPECT_EQ(result.y.rows(), result.t.size());
  EXPECT_GT(result.y.maxCoeff(), 0.02);
}

// Both sides of the balance at the time points, including the power of the diode; x' from the equations.
TEST(ConstrainedGoal, PowersAreTheRateOfTheEnergy) {
  const Scene scene = two_stops();
  const auto backend = make_cpu_backend(1);
  Options options = options_for(Method::goal, 120);
  options.states = StateSelection::all;
  const Result result = solve(scene, *backend, options);
  const PowerBalance& p = result.goal->power;
  const DenseDynamics d = to_dense(scene.dynamics);
  const Matrix H(scene.port->energy_matrix()), F(state_space(*scene.port).F);
  ASSERT_EQ(p.supplied.size(), 121);
  EXPECT_GT(result.y.maxCoeff(), 0);
  for (Index i = 0; i <= 120; ++i) {
    Vector u(1);
    scene.port->u(result.t[i], u);
    const Vector x = result.x.row(i).transpose(), y = result.y.row(i).transpose();
    const double rate = x.dot(H * (d.A * x + d.B * y + F * u)), size = 10 * (1 + x.squaredNorm());
    EXPECT_NEAR(p.supplied[i] - p.dissipated[i], rate, 1e-13 * size);
  }
}

// 25 equal steps miss sin(5e6 pi t) completely: the quantity is zero, and the estimate sees all of it on the halved
// grid.
TEST(ConstrainedGoal, ABlindGridHasNoEffectivityAndMeetsNoTolerance) {
  const auto backend = make_cpu_backend(1);
  for (const char* name : {"ladder", "ladder-diodes"}) {
    const Scene scene = make_scene(name);
    GoalOptions goal;
    goal.first_cells = 25;
    Options options = options_for(Method::goal, 25);
    options.goal = std::make_shared<GoalOptions>(goal);
    options.tolerance = 1e-3;  // above all of it
    const Result blind = solve(scene, *backend, options);
    EXPECT_EQ(blind.status, Status::tolerance_not_met);
    EXPECT_FALSE(blind.goal->history.back().effectivity);
    EXPECT_TRUE(blind.warning.starts_with("the input nearly vanishes")) << blind.warning;
    options.steps = 0;
    options.tolerance = 1e-13;
    const Result seeing = solve(scene, *backend, options);
    EXPECT_EQ(seeing.status, Status::solved) << seeing.reason;
    EXPECT_TRUE(seeing.warning.empty());
    EXPECT_TRUE(seeing.goal->history.back().effectivity);
    EXPECT_EQ(seeing.goal->history.at(1).cells, 50);  // all of the blind grid's cells are halved
  }
}

TEST(ConstrainedGoal, RefusesWhatItCannotDo) {
  const auto backend = make_cpu_backend(1);
  GoalOptions goal;
  goal.scheme = StepScheme::exponential;
  Options options = options_for(Method::goal, 50);
  options.goal = std::make_shared<GoalOptions>(goal);
  EXPECT_TRUE(refusal([&] { solve(two_stops(), *backend, options); }).starts_with("scheme: exponential"));
  options.goal = nullptr;
  Scene ideal = two_stops();
  ideal.M = Matrix(Matrix::Zero(2, 2));
  ideal.lcp_class = LcpClass::automatic;
  EXPECT_TRUE(refusal([&] { solve(ideal, *backend, options); }).starts_with("method: goal needs M of class P"));
}

}  // namespace
}  // namespace bromwich

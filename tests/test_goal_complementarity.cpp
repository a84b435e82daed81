// Goal-oriented grids of scenes that switch: steps, balance, derivatives along the active sets, and what the grids
// find.

#include "core/error.hpp"
#include "core/goal_complementarity.hpp"
#include "core/goal_indicators.hpp"
#include "core/scenes/catalogue.hpp"
#include "refusal.hpp"
#include "run.hpp"
#include "tests/reference.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

constexpr StepScheme constrained_schemes[] = {StepScheme::euler, StepScheme::midpoint};

/// Two masses (q, p each) coupled by springs and damped, both pushed by a wave, each with a soft stop:
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
  auto& d = std::get<DenseDynamics>(scene.dynamics);
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

Index switches(const ConstraintPath& path) {
  Index count = 0;
  for (std::size_t i = 1; i < path.modes.size(); ++i) count += path.modes[i] != path.modes[i - 1];
  return count;
}

// The equations of a step, written out: rounding of terms of the size of x, and |A| h of it.
TEST(ConstrainedSteps, SolveTheirEquations) {
  for (const Scene& scene : switching_scenes())
    for (const StepScheme scheme : constrained_schemes) {
      Setting s(scene);
      const Vector t = uneven_grid(scene.T, 300);
      const ConstrainedSolution solution = solve_constrained(s.system, scheme, t, scene.x0);
      ASSERT_EQ(solution.unsolved, -1);
      EXPECT_GE(switches(solution.path), 2) << scene.name;
      const DenseDynamics d = to_dense(scene.dynamics);
      const Matrix M = to_dense(scene.M);
      const Matrix F = Matrix(state_space(*scene.port).F);
      Vector u(1);
      double worst = 0, size = solution.x.cwiseAbs().maxCoeff();
      for (Index i = 0; i < 300; ++i) {
        const double h = t[i + 1] - t[i], t_e = scheme == StepScheme::euler ? t[i + 1] : t[i] + h / 2;
        const Vector a = solution.x.row(i).transpose(), b = solution.x.row(i + 1).transpose();
        const Vector e = scheme == StepScheme::euler ? b : Vector((a + b) / 2), y = solution.path.y.row(i).transpose();
        scene.port->u(t_e, u);
        const Vector r = a + h * (d.A * e + d.B * y + F * u) - b;
        const Vector w = d.N * e + M * y + s.system.g(t_e);
        worst = std::max(worst, r.cwiseAbs().maxCoeff());
        EXPECT_LE(y.cwiseMin(w).cwiseAbs().maxCoeff(), 1e-13 * std::max(1., size));
      }
      EXPECT_LE(worst, 1e-12 * size) << scene.name;
    }
}

// v = -||x_i - x_{i-1}||^2 / 2 in the norm of Q^T E for Euler, with what the constraints take out counted as supplied;
// h/12 ||x_i - x_{i-1}||^2 in that of Q^T R Q and the variation of u for midpoint, where u is constant.
TEST(ConstrainedBalance, ViolationOfEulerIsTheSquareOfTheStep) {
  for (const Scene& scene : switching_scenes()) {
    Setting s(scene);
    const Vector t = uneven_grid(scene.T, 300);
    const ConstrainedSolution solution = solve_constrained(s.system, StepScheme::euler, t, scene.x0);
    const EnergyBalance b = energy_balance({s.system.port(), StepScheme::euler, t, solution.x, 1, &solution.path});
    const RowMatrix step = solution.x.bottomRows(300) - solution.x.topRows(300);
    const Vector expected = -0.5 * (step * s.system.port().energy_matrix()).cwiseProduct(step).rowwise().sum();
    EXPECT_LE((b.violation - expected).cwiseAbs().maxCoeff(), 1e-13 * b.energy.cwiseAbs().maxCoeff()) << scene.name;
  }
}

// y follows x: central differences of the value with y solved for anew. All active sets stay. v_i moves by e times the
// energy and is smaller than that by some 1e3: the error e^2 1e3 is below 1e-8, and rounding eps/e 1e3 too.
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
        std::vector<Index> modes;
        bool stable = true;
        const auto at = [&](double shift, RowMatrix* gradient) {
          const RowMatrix moved = x + shift * direction;
          Trajectory path{s.system.port(), scheme, t, moved};
          const ConstraintPath constraints = constraints_along(s.system, *s.backend, path);
          path.constraints = &constraints;
          if (modes.empty()) modes = constraints.modes;
          stable = stable && modes == constraints.modes;
          if (gradient) *gradient = quantity->gradient(path);
          return quantity->value(path);
        };
        RowMatrix gradient;
        const double value = at(0, &gradient), e = 1e-6, differences = (at(e, nullptr) - at(-e, nullptr)) / (2 * e);
        ASSERT_TRUE(stable);
        const double derivative = gradient.cwiseProduct(direction).sum();
        EXPECT_NEAR(differences, derivative, 1e-6 * std::max(value, std::abs(derivative)))
            << scene.name << " " << quantity->name();
      }
}

// The derivative of the quantity of the *solution* to the initial state is l_0: the whole chain of active sets.
TEST(ConstrainedAdjoint, GivesTheDerivativeToTheInitialState) {
  for (const Scene& scene : switching_scenes())
    for (const StepScheme scheme : constrained_schemes)
      for (const auto& quantity : {local_balance(), end_state()}) {
        Setting s(scene);
        const Vector t = uneven_grid(scene.T, 200);
        std::vector<Index> modes;
        bool stable = true;
        const auto solved = [&](const Vector& x0) {
          ConstrainedSolution solution = solve_constrained(s.system, scheme, t, x0);
          if (modes.empty()) modes = solution.path.modes;
          stable = stable && modes == solution.path.modes;
          return solution;
        };
        const auto value = [&](const Vector& x0) {
          const ConstrainedSolution solution = solved(x0);
          return quantity->value({s.system.port(), scheme, t, solution.x, 1, &solution.path});
        };
        const ConstrainedSolution solution = solved(scene.x0);
        const ConstrainedChain chain = constrained_chain(s.system, scheme, t, scene.x0, solution.path);
        const RowMatrix gradient = quantity->gradient({s.system.port(), scheme, t, solution.x, 1, &solution.path});
        const auto plan = s.backend->step_chain(chain.problem);
        const double size = solution.x.cwiseAbs().maxCoeff(), e = 1e-5;
        EXPECT_LE((forward(*s.backend, *plan, chain.d) - solution.x).cwiseAbs().maxCoeff(), 1e-12 * size);
        const RowMatrix l = adjoint(*s.backend, *plan, gradient, {});
        for (const Index k : {0, 1, 3}) {
          Vector direction = Vector::Zero(scene.states());
          direction[k] = size;
          const double differences = (value(scene.x0 + e * direction) - value(scene.x0 - e * direction)) / (2 * e);
          const double derivative = l.row(0).dot(direction.transpose());
          EXPECT_NEAR(differences, derivative, 1e-6 * std::max(std::abs(value(scene.x0)), std::abs(derivative)))
              << scene.name << " " << quantity->name() << " " << k;
        }
        ASSERT_TRUE(stable) << scene.name;
        for (const AdjointMethod method : {AdjointMethod::doubling, AdjointMethod::scan})
          EXPECT_LE((adjoint(*s.backend, *plan, gradient, {method, 1}) - l).cwiseAbs().maxCoeff(),
                    1e-13 * l.cwiseAbs().maxCoeff());
      }
}

}  // namespace
}  // namespace bromwich

// Parts of a cycle of goal-oriented grids: products of many rows, inputs evaluated once, one evaluation of a quantity,
// and identical bits for any number of threads.

#include "catalogue/catalogue.hpp"
#include "core/goal/goal.hpp"
#include "core/goal/grid_adaptation.hpp"
#include "core/goal/indicators.hpp"
#include "core/numerics/row_products.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace bromwich {
namespace {

constexpr StepScheme all_schemes[] = {StepScheme::euler, StepScheme::midpoint, StepScheme::exponential};

// About a third of the entries, and one empty column.
SparseMatrix random_sparse(reference::Random& random, Index rows, Index cols) {
  Matrix A = random.matrix(rows, cols);
  A = A.unaryExpr([&](double a) { return random.uniform() < 0.3 ? a : 0.; }).eval();
  if (cols > 2) A.col(1).setZero();
  return A.sparseView();
}

// Sums of `inner` terms in another order.
TEST(RowProducts, AreThoseOfDenseMatrices) {
  reference::Random random(3);
  for (const Index rows : {1, 15, 16, 17, 100})
    for (const auto& [inner, cols] : {std::pair<Index, Index>(1, 5), {5, 1}, {7, 7}, {90, 70}}) {
      const SparseMatrix A = random_sparse(random, inner, cols), S = random_sparse(random, inner, inner);
      const RowMatrix wide = random.matrix(rows + 2, inner);
      const Eigen::Ref<const RowMatrix> x = wide.middleRows(1, rows);
      const RowMatrix expected = x * Matrix(A);
      const double size = 1e-14 * double(inner);
      EXPECT_LE((row_products(x, A) - expected).cwiseAbs().maxCoeff(), size);
      EXPECT_LE((row_forms(x, S) - (x * Matrix(S)).cwiseProduct(x).rowwise().sum()).cwiseAbs().maxCoeff(),
                size * double(inner));
      const Vector w = random.vector(rows);
      const RowMatrix start = random.matrix(rows + 1, cols);
      RowMatrix to = start;
      add_row_products(w, x, A, to.topRows(rows));
      EXPECT_LE((to.topRows(rows) - start.topRows(rows) - w.asDiagonal() * expected).cwiseAbs().maxCoeff(), size);
      EXPECT_EQ(to.row(rows), start.row(rows));
    }
}

// An input with two ports that counts its evaluations.
struct CountedInput {
  std::vector<double> asked;
  PortHamiltonian port = *make_scene("ph-toy").port;
  CountedInput() {
    port.B = Matrix(Matrix::Identity(3, 2)).sparseView();
    port.u = [this](double t, Eigen::Ref<Vector> u) {
      asked.push_back(t);
      u[1] = std::sin(3 * t);  // u[0] is 0 where it is not set
    };
  }
  std::size_t count() {
    const std::size_t calls = asked.size();
    EXPECT_TRUE(std::is_sorted(asked.begin(), asked.end()));
    asked.clear();
    return calls;
  }
};

TEST(Inputs, AreAskedForOncePerPoint) {
  CountedInput input;
  const PortSystem system(input.port, 10);
  const Vector t = first_grid(10, 40, {});
  const Vector fine = halved(t), next = bisected(t, {0, 3, 4, 39});
  for (const double s : {0., 0.3, 1.}) {
    input.count();
    const auto expect_inputs = [&](const Vector& grid, std::size_t calls) {
      const RowMatrix u = system.inputs(grid, s);
      EXPECT_EQ(input.count(), calls) << s;
      ASSERT_EQ(u.rows(), grid.size() - 1);
      for (Index i = 0; i < u.rows(); ++i) {
        EXPECT_EQ(u(i, 0), 0);
        EXPECT_NEAR(u(i, 1), std::sin(3 * ((1 - s) * grid[i] + s * grid[i + 1])), 3 * 8 * epsilon * 10);
      }
    };
    const bool within = s == 0.3;
    expect_inputs(t, 40);
    expect_inputs(fine, within ? 80 : 40);
    expect_inputs(t, 0);
    expect_inputs(fine, 0);
    expect_inputs(next, 0);                        // cells of either grid
    expect_inputs(halved(next), within ? 16 : 8);  // only new cells and new points
    expect_inputs(t, within ? 4 : 0);  // the first grid is forgotten, except for values reused by later ones
  }
}

TEST(Inputs, AreTakenFromInsideTheSteps) {
  PortHamiltonian port = *make_scene("ph-toy").port;
  port.u = [](double t, Eigen::Ref<Vector> u) { u[0] = t < 5 ? 1 : t > 5 ? 2 : 99; };
  const PortSystem system(port, 10);
  const Vector t = first_grid(10, 4, {});
  EXPECT_EQ(system.inputs(t, 1), Vector({{1, 1, 2, 2}}));
  EXPECT_EQ(system.inputs(t, 0), Vector({{1, 1, 2, 2}}));
  const Vector half = t.head(3);  // ends at the jump
  EXPECT_EQ(system.inputs(half, 1), Vector({{1, 1}}));
}

// v is quadratic in x: differences of any length give its derivative. Rounding: Σ |w v| eps.
TEST(EnergyBalance, GradientsOfManyStatesAreThoseOfDifferences) {
  reference::Random random(7);
  const Scene scene = make_scene("ladder", {{"n", 30}});  // 91 states
  const PortSystem system(*scene.port, scene.T);
  const auto backend = make_cpu_backend(2);
  for (const Index M : {1, 16, 1200}) {
    const Vector t = Vector::LinSpaced(M + 1, 0, scene.T), w = random.vector(M);
    const RowMatrix x = random.matrix(M + 1, system.states()), e = random.matrix(M + 1, system.states());
    for (const StepScheme scheme : all_schemes) {
      if (scheme == StepScheme::exponential && M > 16) continue;
      const auto balance = [&](double s) {
        const RowMatrix moved = x + s * e;
        return energy_balance({system, scheme, t, moved, 1, nullptr, backend.get()});
      };
      const EnergyBalance more = balance(1), less = balance(-1);
      const double differences = w.dot(more.violation - less.violation) / 2;
      const double derivative =
          balance_gradient({system, scheme, t, x, 1, nullptr, backend.get()}, w).cwiseProduct(e).sum();
      const double size = more.energy.sum() + more.dissipated.sum() + less.energy.sum() + less.dissipated.sum() +
                          more.supplied.cwiseAbs().sum();
      EXPECT_NEAR(differences, derivative, 1e-13 * size) << M << " " << to_string(scheme);
    }
  }
}

TEST(Quantity, EvaluatesAllAtOnce) {
  reference::Random random(2);
  const Scene scene = make_scene("ph-toy");
  const PortSystem system(*scene.port, scene.T);
  const Vector t = first_grid(scene.T, 12, {});
  const RowMatrix x = random.matrix(13, 3);
  UserQuantity user;
  user.end = [](double, const Vector& end) { return end[0]; };
  user.end_gradient = [](double, const Vector&) { return Vector{{1, 0, 0}}; };
  for (const auto& quantity : {global_balance(), local_balance(), weighted_balance(10), user_quantity(user)})
    for (const StepScheme scheme : all_schemes)
      for (const Index per_cell : {1, 2}) {
        const Trajectory path{system, scheme, t, x, per_cell};
        const QuantityEvaluation e = quantity->evaluate(path, true);
        EXPECT_EQ(e.value, quantity->value(path)) << quantity->name();
        EXPECT_EQ(e.rounding, quantity->rounding(path));
        EXPECT_EQ(e.gradient, quantity->gradient(path));
        EXPECT_EQ(quantity->evaluate(path, false).value, e.value);
        EXPECT_EQ(quantity->evaluate(path, false).gradient.size(), 0);
      }
}

TEST(Backends, ShareOutEveryNumberOnce) {
  for (const int threads : {1, 3}) {
    const auto backend = make_cpu_backend(threads);
    for (const Index count : {0, 1, 7, 8, 9, 100}) {
      std::vector<int> visits(std::size_t(count), 0);
      backend->each_range(count, 8, [&](Index first, Index last) {
        EXPECT_EQ(first % 8, 0);
        EXPECT_EQ(last, std::min<Index>(first + 8, count));
        for (Index i = first; i < last; ++i) ++visits[std::size_t(i)];
      });
      EXPECT_EQ(visits, std::vector<int>(std::size_t(count), 1));
    }
  }
}

// The grid has several ranges of rows.
TEST(Goal, CyclesDoNotDependOnTheThreads) {
  const Scene scene = make_scene("ladder", {{"n", 30}});
  const PortSystem system(*scene.port, scene.T);
  const Vector t = bisected(first_grid(scene.T, 1000, {}), {1, 2, 500, 999});
  for (const StepScheme scheme : {StepScheme::euler, StepScheme::midpoint}) {
    GoalOptions goal;
    goal.scheme = scheme;
    const GoalEvaluation one = evaluate_goal(system, *make_cpu_backend(1), goal, t, scene.x0);
    const GoalEvaluation three = evaluate_goal(system, *make_cpu_backend(3), goal, t, scene.x0);
    EXPECT_EQ(one.x, three.x);
    EXPECT_EQ(one.quantity, three.quantity);
    EXPECT_EQ(one.indicators, three.indicators);
  }
}

}  // namespace
}  // namespace bromwich

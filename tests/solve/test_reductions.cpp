// What is taken out of a scene before it is solved, and the way of values there and back.

#include "core/solve/reductions.hpp"

#include "core/solve/dense_output.hpp"
#include "cpu/cpu_backend.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace bromwich {
namespace {

// E x' = A x + B y + F phi with x far from size 1: E, F and the units are taken out.
Scene stated(double unit) {
  Scene scene;
  scene.name = "stated";
  scene.dynamics =
      DenseDynamics{Matrix{{-2, 0.5}, {0, -3}}, Matrix{{1 / unit}, {0}}, Matrix{{unit, 0}}, Matrix{{2, 0.3}, {0, 1}}};
  scene.M = Matrix{{1}};
  scene.x0 = Vector{{3 / unit, -1 / unit}};
  scene.T = 1;
  return scene;
}

TEST(Reductions, ValuesComeBackAsTheyWent) {
  const Scene scene = stated(1e6);
  InnerOptions options;
  options.states = StateSelection::all;
  const Reductions reduced(scene, options, reductions_of_scene());
  EXPECT_FALSE(reduced.scene().dynamics->has_mass());
  EXPECT_NEAR(std::log10(reduced.scene().x0.cwiseAbs().maxCoeff()), 0, 1);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> value(-1, 1);
  Result given;
  given.x_components = {0, 1};
  for (RowMatrix* rows : {&given.y, &given.trace}) *rows = RowMatrix::NullaryExpr(5, 1, [&] { return value(random); });
  given.x = RowMatrix::NullaryExpr(5, 2, [&] { return value(random); });
  Result there = given;
  reduced.there(there);
  EXPECT_GT((there.x - given.x).cwiseAbs().maxCoeff(), 1) << "in other units";
  reduced.back(there);
  // A factor and its inverse: two roundings.
  const double two = 2 * std::numeric_limits<double>::epsilon();
  EXPECT_LE((there.x - given.x).cwiseAbs().maxCoeff(), two);
  EXPECT_LE((there.y - given.y).cwiseAbs().maxCoeff(), two);
  EXPECT_LE((there.trace - given.trace).cwiseAbs().maxCoeff(), two);
}

// y = 0 while N x > 0, and x_1 decays alone: x_0(t) between the time points in closed form, in all units. x_2' = -3
// x_2, and 2 x_1' + 0.3 x_2' = -2 x_1 + 0.5 x_2 is x_1' = -x_1 + 0.7 x_2.
TEST(Reductions, ValuesBetweenTimePointsAreThoseOfTheStatedScene) {
  const auto backend = make_cpu_backend(1);
  for (const double unit : {1e-6, 1.0, 1e6}) {
    const Scene scene = stated(unit);
    Options options;
    options.steps = 16;
    options.states = StateSelection::all;
    const Result result = solve(scene, *backend, options);
    ASSERT_EQ(result.status, Status::solved) << result.reason;
    const std::vector<double> times{0.1, 0.25, 0.7777, 1};
    const Result at = at_times(scene, *backend, result, times);
    for (std::size_t k = 0; k < times.size(); ++k) {
      const double t = times[k], x2 = -std::exp(-3 * t), x1 = (3 - 0.35) * std::exp(-t) + 0.35 * std::exp(-3 * t);
      // The exponential is exact while y = 0: a few roundings of each step.
      EXPECT_NEAR(at.x(Index(k), 0) * unit, x1, 1e-12) << unit << " " << t;
      EXPECT_NEAR(at.x(Index(k), 1) * unit, x2, 1e-12) << unit << " " << t;
    }
    EXPECT_EQ(at.x.row(1), result.x.row(4)) << "a time point, to the last digit";
    const Matrix states = states_at(scene, *backend, result, {4, 16});
    EXPECT_LE((states.col(0).transpose() - result.x.row(4)).cwiseAbs().maxCoeff() * unit, 1e-12);
    EXPECT_LE((states.col(1).transpose() - result.x.row(16)).cwiseAbs().maxCoeff() * unit, 1e-12);
  }
}

// x' = a x - y held at x <= 1: x = min(1, x(0) e^{a t}). e^{80} says nothing of conditions on x(0) alone.
Scene held(double a) {
  Scene scene;
  scene.name = "held";
  scene.dynamics = DenseDynamics{Matrix{{a, 0}, {0, -1}}, Matrix{{-1}, {0}}, Matrix{{-1, 0}}};
  scene.M = Matrix{{0}};
  scene.g = [](double, Eigen::Ref<Vector> g) { g[0] = 1; };
  scene.boundary = BoundaryCondition{Matrix{{2, 1}, {0, 4}}, Matrix::Zero(2, 2), Vector{{2 + 0.2 / a, 8}}};
  scene.T = 1;
  return scene;
}

TEST(Reductions, ConditionsOnTheStartAloneAreAnInitialValue) {
  const auto backend = make_cpu_backend(1);
  for (const auto& [method, a] : {std::pair(Method::automatic, 80), std::pair(Method::events, 80),
                                  std::pair(Method::march, 80), std::pair(Method::galerkin, 3)}) {
    SCOPED_TRACE(to_string(method));
    Options options;
    options.method = method;
    if (method != Method::events) options.steps = 400;
    options.states = StateSelection::all;
    const Result r = solve(held(a), *backend, options);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_LE(*r.boundary_residual, 1e-15);
    for (Index j = 0; j < Index(r.t.size()); ++j) {
      EXPECT_NEAR(r.x(j, 0), std::min(1.0, 0.1 / a * std::exp(a * r.t[j])), 1e-3 * a) << r.t[j];
      EXPECT_NEAR(r.x(j, 1), 2 * std::exp(-r.t[j]), 1e-6) << r.t[j];
    }
  }
}

}  // namespace
}  // namespace bromwich

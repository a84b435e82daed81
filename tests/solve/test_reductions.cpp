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

}  // namespace
}  // namespace bromwich

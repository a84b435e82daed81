// Solutions of coarser grids as the first iterates of finer ones, and the error that the sweeps leave.

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/solve/error_control.hpp"
#include "tests/support/true_error.hpp"

#include <gtest/gtest.h>

namespace bromwich::tolerance_test {
namespace {

TEST(IterationError, IsTheSumOfTheSweepsThatAreLeft) {
  // Changes c^k leave c^(n+1)/(1-c).
  EXPECT_NEAR(iteration_error({1, 0.5, 0.25, 0.125, 0.0625}), 0.0625, 1e-14);
  EXPECT_EQ(iteration_error({}), 0);
  EXPECT_EQ(iteration_error({1, 0}), 0);
  EXPECT_NEAR(iteration_error({1e-13, 1e-13, 1e-13}), 99e-13, 1e-14);  // no contraction: large but finite
}

TEST(FirstIterate, OfTheSolutionLeavesNothingToDo) {
  const Scene scene = make_scene("signorini", {{"Q", 15}});
  Options options = options_for(Method::contour, 200);
  const Result cold = run(scene, options);
  ASSERT_EQ(cold.status, Status::solved) << cold.reason;
  options.tuning.first_iterate = &cold.y;
  const Result warm = run(scene, options);
  ASSERT_EQ(warm.status, Status::solved) << warm.reason;
  EXPECT_LE(warm.iterations, 3);
  EXPECT_LE(distance(warm.y, cold.y), same_problem);
}

TEST(FirstIterate, IsTheCoarserGridInErrorControl) {
  const Scene scene = make_scene("signorini");
  Options options = options_to(1e-5, Method::contour);
  options.iteration_tolerance = 1e-8;
  const Result result = run(scene, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  options.tolerance = 0;
  options.steps = result.steps;
  EXPECT_LT(result.iterations, run(scene, options).iterations);
}

TEST(FirstIterate, DoesNotDecideWhichSolutionOfAZSceneIsFound) {
  const Scene scene = make_scene("dlcp-small");
  Options options = options_for(Method::contour, 100);
  const RowMatrix other = RowMatrix::Constant(101, scene.constraints(), 10);
  const Result cold = run(scene, options);
  options.tuning.first_iterate = &other;
  EXPECT_LE(distance(run(scene, options).y, cold.y), same_problem);
}

TEST(FirstIterate, OfAnotherShapeIsRefused) {
  const RowMatrix other = RowMatrix::Zero(11, 1);
  Options options = options_for(Method::contour, 100);
  options.tuning.first_iterate = &other;
  EXPECT_THROW(run(make_scene("bridge"), options), Error);
}

}  // namespace
}  // namespace bromwich::tolerance_test

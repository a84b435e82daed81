// A result between its time points: against the same function y on a finer grid, and against exact solutions.

#include "core/base/error.hpp"
#include "core/catalogue/catalogue.hpp"
#include "core/solve/dense_output.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

Options with_states(Index steps) {
  Options options = options_for(Method::march, steps);
  options.states = StateSelection::all;
  return options;
}

/// The same piecewise-linear y on a grid of half the step.
Result refined(const Result& result) {
  Result fine = result;
  fine.steps = 2 * result.steps;
  fine.y.resize(fine.steps + 1, result.y.cols());
  for (Index j = 0; j <= result.steps; ++j) fine.y.row(2 * j) = result.y.row(j);
  for (Index j = 0; j < result.steps; ++j) fine.y.row(2 * j + 1) = (result.y.row(j) + result.y.row(j + 1)) / 2;
  return fine;
}

TEST(DenseOutput, IsTheStateOfPiecewiseLinearY) {
  Scene scene = make_scene("signorini", {{"Q", 7}});
  scene.f = {};  // its samples differ between the grids
  const auto backend = make_cpu_backend(1);
  const Result result = solve(scene, *backend, with_states(20));
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  const double h = scene.T / 20;
  const Result between = at_times(scene, *backend, result, {0.5 * h, 7.5 * h, 19.5 * h});
  const Matrix known = states_at(scene, *backend, refined(result), {1, 15, 39});
  EXPECT_LE(distance(between.x, RowMatrix(known.transpose())), same_problem);
  EXPECT_LE(distance(between.y.row(1), (result.y.row(7) + result.y.row(8)) / 2), 1e-15);
}

TEST(DenseOutput, AtTimePointsIsTheResult) {
  const Scene scene = make_scene("bridge");
  const auto backend = make_cpu_backend(1);
  const Result result = solve(scene, *backend, with_states(60));
  const Result same = at_times(scene, *backend, result, {0, result.t[17], result.t[60]});
  for (const auto& [row, j] : {std::pair<Index, Index>{0, 0}, {1, 17}, {2, 60}}) {
    EXPECT_EQ(same.y.row(row), result.y.row(j));
    EXPECT_EQ(same.x.row(row), result.x.row(j));
  }
}

TEST(DenseOutput, HasTheOrderOfTheMethod) {
  const Scene scene = make_scene("bridge");
  const auto backend = make_cpu_backend(1);
  const std::vector<double> times{1.234, 4.321, 8.765};
  std::vector<double> errors;
  for (const Index steps : {150, 600}) {
    const Result between = at_times(scene, *backend, solve(scene, *backend, with_states(steps)), times);
    double error = 0;
    Vector x(scene.states()), y(scene.constraints());
    for (Index k = 0; k < Index(times.size()); ++k) {
      scene.exact(times[std::size_t(k)], x, y);
      error = std::max(error, (between.x.row(k) - x.transpose()).cwiseAbs().maxCoeff());
    }
    errors.push_back(error);
  }
  EXPECT_LE(errors[0], 1e-2);
  EXPECT_LE(errors[1], errors[0] / 10);  // 16 if the times lie alike within their steps
}

TEST(DenseOutput, RefusesWhatItCannotKnow) {
  const Scene scene = make_scene("bridge");
  const auto backend = make_cpu_backend(1);
  const Result march = solve(scene, *backend, with_states(60)), euler = run(scene, Method::euler, 60);
  EXPECT_THROW(at_times(scene, *backend, march, {-1e-3}), Error);
  EXPECT_THROW(at_times(scene, *backend, march, {scene.T + 1}), Error);
  EXPECT_THROW(at_times(scene, *backend, march, {NAN}), Error);
  EXPECT_THROW(at_times(scene, *backend, euler, {scene.T / 61}), Error);
  EXPECT_NO_THROW(at_times(scene, *backend, euler, {scene.T / 60}));
}

TEST(DenseOutput, EndsWithTheRowsThatAreValid) {
  const Scene scene = make_scene("bridge");
  const auto backend = make_cpu_backend(1);
  Result result = solve(scene, *backend, with_states(60));
  result.y.bottomRows(30).setConstant(NAN);
  const double h = scene.T / 60;
  const Result between = at_times(scene, *backend, result, {29.5 * h, 30.5 * h});
  EXPECT_TRUE(between.y.row(0).allFinite() && between.x.row(0).allFinite());
  EXPECT_TRUE(between.y.row(1).array().isNaN().all() && between.x.row(1).array().isNaN().all());
}

}  // namespace
}  // namespace bromwich

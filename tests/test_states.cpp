// The state where it is asked for: components by observers, time points by contours, both against stepping.

#include "core/error.hpp"
#include "core/scenes/catalogue.hpp"
#include "core/solve.hpp"
#include "run.hpp"

#include <gtest/gtest.h>

namespace bromwich {
namespace {

// Rows of `result.x` (all components) against states_at.
void expect_same_states(const Scene& scene, Index steps) {
  Options options = options_for(Method::contour, steps);
  options.states = StateSelection::all;
  const auto backend = make_cpu_backend(1);
  const Result result = solve(scene, *backend, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  const std::vector<Index> rows{0, 1, std::min<Index>(2, steps), steps / 2, steps};
  const Matrix x = states_at(scene, *backend, result, rows);
  ASSERT_EQ(x.rows(), scene.states());
  for (std::size_t c = 0; c < rows.size(); ++c) {
    const double scale = std::max(1.0, result.x.row(rows[c]).cwiseAbs().maxCoeff());
    // Contours of 25 nodes are good to 7e-15 of the size of what they sum, lags of size 1 and up to `steps` of them.
    EXPECT_LE((x.col(Index(c)).transpose() - result.x.row(rows[c])).cwiseAbs().maxCoeff(), 1e-11 * scale)
        << scene.name << ", row " << rows[c];
  }
}

TEST(StatesAt, EqualTheObserversOfSignorini) {
  for (const double Q : {1, 2, 7, 39}) expect_same_states(make_scene("signorini", {{"Q", Q}}), 400);
  for (const Index steps : {1, 3, 5, 20}) expect_same_states(make_scene("signorini", {{"Q", 7}}), steps);
}

TEST(StatesAt, EqualSteppingOfDenseScenes) {
  expect_same_states(make_scene("dlcp-small"), 4000);  // by contours: few rows, many steps
  expect_same_states(make_scene("dlcp-small"), 100);
  expect_same_states(make_scene("bridge"), 600);
}

TEST(StatesAt, RefusesWhatItCannotDo) {
  const Scene scene = make_scene("signorini", {{"Q", 7}});
  const auto backend = make_cpu_backend(1);
  const Result march = solve(scene, *backend, options_for(Method::march, 16));
  EXPECT_THROW(states_at(scene, *backend, march, {17}), Error);
  EXPECT_THROW(states_at(scene, *backend, march, {-1}), Error);
  EXPECT_THROW(states_at(make_scene("bridge"), *backend, march, {1}), Error);
  EXPECT_THROW(states_at(scene, *backend, solve(scene, *backend, options_for(Method::euler, 16)), {1}), Error);
  EXPECT_EQ(states_at(scene, *backend, march, {}).cols(), 0);
}

// N x as the methods hand it out against N times the states, whatever way each of them takes to y.
TEST(Trace, IsNTimesTheState) {
  const auto backend = make_cpu_backend(1);
  for (const char* name : {"dlcp-small", "bridge"})
    for (const Method method : {Method::contour, Method::contour_literal, Method::march, Method::euler}) {
      const Scene scene = make_scene(name);
      if (method == Method::contour_literal && scene.name == "bridge") continue;  // eigenvalues on the imaginary axis
      Options options = options_for(method, 64);
      options.states = StateSelection::all;
      options.trace = true;
      options.literal_nodes = 64;
      const Result result = solve(scene, *backend, options);
      ASSERT_EQ(result.status, Status::solved) << name << ", " << to_string(method) << ": " << result.reason;
      const DenseDynamics& d = std::get<DenseDynamics>(scene.dynamics);
      const RowMatrix expected = result.x * d.N.transpose();
      ASSERT_EQ(result.trace.rows(), expected.rows());
      // contour-literal accepts contours that miss N e^{At} B by up to 100 times the printed rate e^{-2.06 sqrt P}/sqrt
      // P, 9e-9 here, of t ||N|| ||B||; the others are exact up to rounding.
      const double size = d.N.norm() * (scene.x0.norm() + scene.T * d.B.norm() * result.y.cwiseAbs().maxCoeff());
      const double tolerance = (method == Method::contour_literal ? 9e-7 : 1e-11) * size;
      EXPECT_LE((result.trace - expected).cwiseAbs().maxCoeff(), tolerance) << name << ", " << to_string(method);
    }
}

TEST(Trace, OfSignoriniIsTheLineNextToTheMembrane) {
  const Scene scene = make_scene("signorini", {{"Q", 7}});
  const auto backend = make_cpu_backend(1);
  for (const Method method : {Method::contour, Method::march, Method::euler})
    for (const RecurrenceChoice recurrence : {RecurrenceChoice::modal, RecurrenceChoice::compressed}) {
      Options options = options_for(method, 50);
      options.recurrence = recurrence;
      options.trace = true;
      options.states = StateSelection::list;
      for (Index j = 0; j < 7; ++j) options.components.push_back(7 * j);
      const Result result = solve(scene, *backend, options);
      ASSERT_EQ(result.status, Status::solved) << result.reason;
      // Compressed exponentials hold the kernel to 1e-12 or better.
      EXPECT_LE((result.trace + 2 * result.x).cwiseAbs().maxCoeff(), 1e-10) << to_string(method);
    }
}

TEST(Trace, EndsWhereTheSolutionEndsAndIsEmptyUnasked) {
  const auto backend = make_cpu_backend(1);
  const Scene scene = make_scene("bridge");
  EXPECT_EQ(solve(scene, *backend, options_for(Method::march, 8)).trace.size(), 0);
  Options options = options_for(Method::contour, 400);
  options.trace = true;
  Index polls = 0;
  options.interrupted = [&polls] { return ++polls > 3; };
  const Result result = solve(make_scene("signorini", {{"Q", 15}}), *backend, options);
  ASSERT_EQ(result.status, Status::interrupted);
  ASSERT_EQ(result.trace.rows(), 401);
  for (Index j = 0; j <= 400; ++j) EXPECT_EQ(result.y.row(j).allFinite(), result.trace.row(j).allFinite()) << j;
}

}  // namespace
}  // namespace bromwich

// Sources with as many edges as steps and more, against a filter in closed form: its state between the edges too.

#include "core/solve/dense_output.hpp"
#include "tests/support/clamped_filter.hpp"
#include "tests/support/run.hpp"

#include <algorithm>

namespace bromwich {
namespace {

using oracle::ClampedFilter;

// The largest error of x_0 at the rows, of the largest value; edges are known to within rounding, and so are rows at
// them.
double error_at_rows(const ClampedFilter& filter, const Result& r) {
  const std::vector<double> exact = filter.states({r.t.data(), r.t.data() + r.t.size()});
  double most = 0, size = 0;
  for (Index j = 0; j < r.x.rows(); ++j) {
    most = std::max(most, std::abs(r.x(j, 0) - exact[std::size_t(j)]));
    size = std::max(size, std::abs(exact[std::size_t(j)]));
  }
  return most / size;
}

Scene with_few_steps(Scene scene) {
  scene.default_steps = 40;
  return scene;
}

Result with_first_state(const Scene& scene, Method method, double tolerance, Index steps = 0) {
  Options options = options_for(method, steps);
  options.tolerance = tolerance;
  options.states = StateSelection::list;
  options.components = {0};
  return run(scene, options);
}

// 200 edges, ten time constants apart and less, and 40 default steps: all grids up to these would look at the same
// phases, and the parts between edges in one step would be the same on all of them.
TEST(ManyEdges, MeetTheToleranceByEveryMethod) {
  const ClampedFilter filter{2000, 0.7, 0.4, 100, 0.45};
  constexpr double tolerance = 1e-3;
  for (const Method method :
       {Method::automatic, Method::march, Method::multigrid, Method::contour, Method::galerkin, Method::euler}) {
    const Result r =
        with_first_state(with_few_steps(filter.scene()), method, method == Method::euler ? 1e-2 : tolerance);
    EXPECT_TRUE(r.status == Status::solved || method != Method::automatic) << r.reason;
    if (r.status != Status::solved) continue;
    // Estimates may be off by a factor of two.
    EXPECT_LE(error_at_rows(filter, r), 2 * (method == Method::euler ? 1e-2 : tolerance)) << to_string(method);
  }
}

// Of two periods in a row one is nearly all on or all off; and M = 0, where y holds the state.
TEST(ManyEdges, AreMarchedWithPartsOfTheirOwn) {
  for (const ClampedFilter& filter :
       {ClampedFilter{6000, 0.05, 0.4, 150, 0.03}, ClampedFilter{6000, 0.05, 0.6, 150, 0.97},
        ClampedFilter{3000, 0, 0.4, 150, 0.45, 0.4}}) {
    const auto backend = make_cpu_backend(1);
    Options options = options_for(Method::march);
    options.tolerance_x = 1e-3;
    options.states = StateSelection::all;
    const Result r = solve(with_few_steps(filter.scene()), *backend, options);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_LE(error_at_rows(filter, r), 2e-3) << filter.duty;
  }
}

// Lag weights and parts of few lengths: the rows, and places between them.
TEST(ManyEdges, OfSparseScenesMeetTheTolerance) {
  for (const ClampedFilter& filter :
       {ClampedFilter{26480, 0.0956, 0.815, 200, 0.84}, ClampedFilter{1588, 0.00247, 0.575, 100, 0.605},
        ClampedFilter{194.4, 0.00288, 0.583, 30, 0.546}}) {
    constexpr double tolerance = 1e-2;
    const Scene scene = filter.sparse_scene();
    const Result r = with_first_state(scene, Method::march, tolerance, 100);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_LE(error_at_rows(filter, r), 2 * tolerance) << filter.periods;
    std::vector<double> times;
    for (int k = 0; k < 12; ++k) times.push_back(0.05 + 0.0791234 * k);
    const Result between = at_times(scene, *make_cpu_backend(1), r, times);
    const std::vector<double> exact = filter.states(times);
    for (std::size_t k = 0; k < times.size(); ++k)
      EXPECT_NEAR(between.x(Index(k), 0), exact[k], 2 * tolerance) << filter.periods << " " << times[k];
  }
}

// Six edges and more a step: the rows are off, and say by how much.
TEST(ManyEdges, GivenStepsAreCertified) {
  const ClampedFilter filter{120000, 0.7, 0.4, 3000, 0.45};
  const Result r = with_first_state(filter.scene(), Method::march, 0, 400);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  ASSERT_TRUE(r.certificate);
  const double error = error_at_rows(filter, r);
  EXPECT_GE(r.certificate->error_of_x, 0.5 * error);
  EXPECT_LE(r.certificate->error_of_x, 2 * error);
}

// A rate of 1e12: the layer behind an edge is shorter than the rounding of T.
TEST(ManyEdges, LayersShorterThanTheRoundingOfTimesArePassed) {
  const ClampedFilter filter{1e12, 1e-9, 0.2, 1, 0.3};
  const Result r = with_first_state(filter.scene(), Method::march, 1e-4);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_LE(error_at_rows(filter, r), 2e-4);
}

// Values between the rows of a sparse scene whose steps are in parts: the states before them are marched again in
// several runs, of which nothing else is kept.
TEST(ManyEdges, StatesBetweenRowsOfLongResultsAreThoseOfTheFilter) {
  const ClampedFilter filter{162, 0.07, 0.78, 3, 0.83};
  const Scene scene = filter.sparse_scene();
  const auto backend = make_cpu_backend(1);
  Options options = options_for(Method::march, 8000);
  options.states = StateSelection::list;
  options.components = {0};
  const Result r = solve(scene, *backend, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  const std::vector<double> times{0.100033, 0.27669, 0.65432, 0.87654, 0.99993};
  const Result between = at_times(scene, *backend, r, times);
  const std::vector<double> exact = filter.states(times);
  // Radau IIA in parts of a quarter of their distance to an edge: 2^-8 / 72 of the layer, and the same for y.
  for (std::size_t k = 0; k < times.size(); ++k)
    EXPECT_NEAR(between.x(Index(k), 0), exact[k], 2.0 / 256 / 72) << times[k];
}

}  // namespace
}  // namespace bromwich

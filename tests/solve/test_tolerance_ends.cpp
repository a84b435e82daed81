// What ends error control before the tolerance is met, and tolerances that are refused.

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/solve/cost.hpp"
#include "tests/support/changed_units.hpp"
#include "tests/support/true_error.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

namespace bromwich::tolerance_test {
namespace {

TEST(ErrorControl, StopsAtRounding) {
  const Result result = run(make_scene("bridge"), options_to(1e-15));
  EXPECT_EQ(result.status, Status::tolerance_not_met);
  EXPECT_FALSE(result.reason.empty());
  ASSERT_TRUE(result.error_estimate);
  EXPECT_GT(*result.error_estimate, 1e-15);
  EXPECT_TRUE(result.y.allFinite()) << "the finest grid is returned";
}

TEST(ErrorControl, SaysBeforeThatNoGridWillDo) {
  // First order: 1e-9 would take 1e9 steps and more.
  const Scene scene = make_scene("dlcp-small");
  const Result result = run(scene, options_to(1e-9, Method::euler));
  EXPECT_EQ(result.status, Status::tolerance_not_met);
  EXPECT_NE(result.reason.find("steps would be needed"), std::string::npos) << result.reason;
  EXPECT_LE(result.steps, 32 * scene.steps());  // as soon as the order is regular
  ASSERT_TRUE(result.error_estimate);
  EXPECT_LE(*result.error_estimate, largest_effectivity * true_error(scene, result));
}

// 1e12 periods: at the times of any grid the source is noise. The first grid says so.
TEST(ErrorControl, GivesUpSourcesThatNoGridResolves) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{1}};
  scene.f = [](double t, Eigen::Ref<Vector> v) { v[0] = std::sin(6e12 * t); };
  scene.x0 = Vector{{1}};
  const Result result = run(scene, options_to(1e-3, Method::march));
  EXPECT_EQ(result.status, Status::tolerance_not_met);
  EXPECT_NE(result.reason.find("no grid of"), std::string::npos) << result.reason;
  EXPECT_LE(result.steps, scene.steps());
}

// Two ideal diodes, one in each direction, hold a node at 0 V, and the capacitor that it charges through a resistor
// too: f + B y = 0, and x is the rounding of these terms. No grid makes it smaller, and it is no error.
TEST(ErrorControl, TakesWhatRoundingLeavesOfZeroForZero) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1.5}}, Matrix{{-0.5, 0.5}}, Matrix{{-0.5}, {0.5}}};
  scene.M = Matrix{{0.5, -0.5}, {-0.5, 0.5}};
  const auto source = [](double t) { return 3 * std::sin(7 * t) + 1.4 * std::fmod(t, 0.3); };
  scene.f = [source](double t, Eigen::Ref<Vector> v) { v[0] = source(t) / 2; };
  scene.g = [source](double t, Eigen::Ref<Vector> v) { v << -source(t) / 2, source(t) / 2; };
  for (int k = 1; k < 7; ++k) scene.breakpoints.push_back(0.3 * k);
  scene.x0 = Vector{{0}};
  scene.T = 2;
  scene.default_steps = 200;
  Options options;
  options.tolerance_x = 1e-3;
  options.states = StateSelection::all;
  for (const int unit : {0, -9, 9}) {
    const Result result = run(oracle::in_other_units(scene, {{unit}, {unit, unit}, {unit, unit}, 0}), options);
    EXPECT_EQ(result.status, Status::solved) << result.reason;
    EXPECT_EQ(result.steps, 200);
    EXPECT_LE(result.x.cwiseAbs().maxCoeff(), 100 * epsilon / oracle::power_of_ten(unit));
  }
}

TEST(ErrorControl, StopsWhereMemoryEnds) {
  const Scene scene = make_scene("signorini", {{"Q", 15}});
  Options options = options_to(1e-6, Method::march);
  options.memory_limit = 1.5 * predicted_cost(scene, Method::march, 800, 0).bytes;  // 1600 steps take twice as much
  const Result result = run(scene, options);
  EXPECT_EQ(result.status, Status::tolerance_not_met);
  EXPECT_EQ(result.steps, 800);
  EXPECT_NE(result.reason.find("refused"), std::string::npos) << result.reason;
}

TEST(ErrorControl, IsInterrupted) {
  Options options = options_to(1e-4, Method::contour);
  options.interrupted = [] { return true; };
  EXPECT_EQ(run(make_scene("signorini", {{"Q", 15}}), options).status, Status::interrupted);
  Index sweeps = 0;  // the first grids need fewer than 40 together
  options.progress = [&sweeps](const Progress&) { ++sweeps; };
  options.interrupted = [&sweeps] { return sweeps > 20; };
  const Result later = run(make_scene("signorini", {{"Q", 15}}), options);
  EXPECT_EQ(later.status, Status::interrupted) << later.reason;
  EXPECT_TRUE(later.y.allFinite()) << "what a coarser grid found is returned";
}

TEST(ErrorControl, RefusesTolerancesThatAreNone) {
  const Scene scene = make_scene("bridge");
  for (double Options::*member : {&Options::tolerance_x, &Options::tolerance_y, &Options::absolute_tolerance}) {
    Options options = options_for(Method::automatic);
    options.*member = -1;
    EXPECT_THROW(run(scene, options), Error);
  }
  for (const double tolerance : {-1e-3, 1.0, std::nan("")}) EXPECT_THROW(run(scene, options_to(tolerance)), Error);
}

TEST(ErrorControl, StepsAreTheFirstGrid) {
  Options options = options_to(1e-2, Method::euler);
  options.steps = 30;
  const Result result = run(make_scene("bridge"), options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  ASSERT_GE(result.errors->grids.size(), 3u);
  EXPECT_EQ(result.errors->grids[0], 30);
  EXPECT_EQ(result.errors->grids[1], 60);
}

}  // namespace
}  // namespace bromwich::tolerance_test

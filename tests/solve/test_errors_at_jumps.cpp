// The warning that given steps are too long where the state jumps or starts fast: with a true estimate, and not where
// they are short enough. Exact solutions.

#include "tests/support/random_sources.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

namespace bromwich {
namespace {

Options all_states_by(Method method, Index steps) {
  Options options = options_for(method, steps);
  options.states = StateSelection::all;
  return options;
}

// x1' = -rate x1, x2' = -1 + y, 0 <= y ⊥ x2 >= 0: the first step of Radau IIA leaves (1 + z/3)/(1 - 2z/3 + z^2/6) of
// x1, z = -rate h.
Scene with_fast_start(double rate) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-rate, 0}, {0, 0}}, Matrix{{0}, {1}}, Matrix{{0, 1}}};
  scene.M = Matrix{{0}};
  scene.f = [](double, Eigen::Ref<Vector> f) { f << 0, -1; };
  scene.x0 = Vector{{1, 0.5}};
  scene.T = 1;
  return scene;
}

double percent_told(const std::string& warning, const std::string& what) {
  const std::string words = what + " by about ";
  const auto place = warning.find(words);
  return place == std::string::npos ? 0 : std::stod(warning.substr(place + words.size()));
}

TEST(ErrorsAtJumps, FastStartsAreTold) {
  const Result r = run(with_fast_start(600), all_states_by(Method::march, 100));
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  const double error = std::abs(r.x(1, 0) - std::exp(-6.0));
  EXPECT_NEAR(error, 0.09, 0.03);  // z = -6: |R(z)| = 1/11
  EXPECT_GE(percent_told(r.warning, "x"), 100 * error / 3) << r.warning;
  EXPECT_LE(percent_told(r.warning, "x"), 100 * error * 3) << r.warning;
  const Result fine = run(with_fast_start(600), all_states_by(Method::march, 4000));
  EXPECT_EQ(fine.warning, "");
  const Result slow = run(with_fast_start(1), all_states_by(Method::march, 100));
  EXPECT_EQ(slow.warning, "");
}

// x' = 1 - x + y, w = x, x0 = -1: the state jumps to 0 and follows 1 - e^-t. Behind the impulse a brief part of a step
// is taken, also with sparse dynamics.
TEST(ErrorsAtJumps, MarchIsRightBehindAnImpulsiveStart) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{0}};
  scene.f = [](double, Eigen::Ref<Vector> f) { f[0] = 1; };
  scene.x0 = Vector{{-1}};
  scene.T = 1;
  for (const bool sparse : {false, true}) {
    Options options = options_for(Method::march, 16);
    options.states = StateSelection::list;
    options.components = {0};
    const Result r = run(sparse ? oracle::among_sparse_states(scene, 600) : scene, options);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    // The brief part is h/160 long, and f moves x by that.
    for (Index j = 1; j <= 16; ++j) EXPECT_NEAR(r.x(j, 0), 1 - std::exp(-r.t[j]), 4e-4);
    EXPECT_NEAR(integral_of_y(r)(16, 0), 1, 4e-4);
  }
}

// x1' = -40 x1 by steps of h = 1/50 decays by 1/1.8 instead of e^-0.8.
TEST(ErrorsAtJumps, ImplicitEulerTellsItsError) {
  const Scene scene = with_fast_start(40);
  const Result r = run(scene, all_states_by(Method::euler, 50));
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  double error = 0;
  for (Index j = 0; j <= 50; ++j) error = std::max(error, std::abs(r.x(j, 0) - std::exp(-40 * r.t[j])));
  EXPECT_NEAR(error, 0.107, 0.001);
  EXPECT_GE(percent_told(r.warning, "x"), 100 * error / 3) << r.warning;
  EXPECT_LE(percent_told(r.warning, "x"), 100 * error * 3) << r.warning;
  EXPECT_EQ(run(scene, all_states_by(Method::march, 50)).warning, "");
  EXPECT_EQ(run(scene, all_states_by(Method::euler, 2000)).warning, "");
}

// An impulse is no infeasibility: methods without one say so.
TEST(ErrorsAtJumps, ContourDoesNotCallAnImpulseInfeasible) {
  const oracle::SourceScene s = oracle::source_scene(41000748);
  ASSERT_TRUE(oracle::locate_events(s.base).decided);
  const Result r = run(s.scene, Method::contour, 100);
  EXPECT_EQ(r.status, Status::unsupported) << r.reason;
  EXPECT_NE(r.reason.find("has to jump"), std::string::npos) << r.reason;
}

}  // namespace
}  // namespace bromwich

// y at time points behind a switch inside a step, where M leaves y to the dynamics. The truth is exact, or from the
// oracle with located events; neither shares code with the march.

#include "core/march/settled_y.hpp"
#include "tests/support/run.hpp"
#include "tests/support/trust.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

// x' = -1 + y, 0 <= y ⊥ x >= 0: y jumps from 0 to 1 at t = x0.
Scene falling(double x0) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{0}};
  scene.f = [](double, Eigen::Ref<Vector> f) { f[0] = -1; };
  scene.x0 = Vector{{x0}};
  scene.T = 1;
  return scene;
}

// At any place of the contact in its step; Radau IIA has 4 (1 - s) for a contact at the part s > 1/3 of its step.
TEST(SettledY, IsExactBehindAContactInsideAStep) {
  for (const Index states : {1, 600})
    for (const double part : {0.1, 0.3, 0.5, 0.7, 0.9}) {
      const Scene dense = falling(0.5 + part / 10);
      Options options = options_for(Method::march, 10);
      options.states = StateSelection::list;
      options.components = {0};
      const Result r = run(states > 1 ? oracle::among_sparse_states(dense, states) : dense, options);
      ASSERT_EQ(r.status, Status::solved) << r.reason;
      EXPECT_EQ(r.y(5, 0), 0);
      for (Index j = 6; j <= 10; ++j) {
        EXPECT_NEAR(r.y(j, 0), 1, 1e-11) << states << " states, contact at " << part << " of step 6, row " << j;
        EXPECT_NEAR(r.x(j, 0), 0, 1e-14);
      }
      // The integral is that of the march: an impulse is not lost.
      EXPECT_NEAR(integral_of_y(r)(10, 0), 1 - (0.5 + part / 10), 1e-12);
    }
}

// x0 on the constraint: y(0) = 0 solves the problem at t = 0, and y(0+) = 1 leads on.
TEST(SettledY, IsTheValueThatLeadsOnAtTheStart) {
  const Result r = run(falling(0), Method::march, 10);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NEAR(r.y(0, 0), 1, 1e-11);
  EXPECT_LE(r.residual, 1e-9);
}

// A constraint of positions keeps the y of the march: there it is the impulse over the step.
TEST(SettledY, LeavesImpactsAlone) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {0, 0}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  scene.M = Matrix{{0}};
  scene.f = [](double, Eigen::Ref<Vector> f) { f << 0, -1; };
  scene.x0 = Vector{{0.055, 0}};
  scene.T = 1;
  const Result r = run(scene, Method::march, 20);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  const double contact = std::sqrt(2 * 0.055);  // 0.3317, in step 7; velocity -0.3317
  EXPECT_NEAR(integral_of_y(r)(20, 0), 1, 1e-9);  // momentum: the fall is stopped and the weight carried
  EXPECT_GT(r.y(7, 0), 0.5 * contact / 0.05);
}

// Random scenes whose M is singular: at all points y is that of the oracle, or `warning` says that it is not.
TEST(SettledY, RandomScenesAreRightOrWarned) {
  int decided = 0, wrong = 0, silent = 0;
  for (std::uint32_t seed = 51000000; seed < 51000150; ++seed) {
    const oracle::SourceScene s = oracle::source_scene(seed);
    if (is_surely_P(LcpMatrix(s.base.scene.M))) continue;
    const oracle::EventSolution truth = oracle::locate_events(s.base);
    if (!truth.decided || !truth.y_unique || truth.jumps > 0) continue;
    Options options = options_for(Method::march, 100);
    options.states = StateSelection::all;
    const Result r = run(s.scene, options);
    if (r.status != Status::solved) continue;
    ++decided;
    if (oracle::true_error(s, truth, r).largest() <= 0.06) continue;
    ++wrong;
    silent += r.warning.empty();
  }
  EXPECT_GE(decided, 40);
  EXPECT_LE(wrong, decided / 15);
  EXPECT_EQ(silent, 0);
}

}  // namespace
}  // namespace bromwich

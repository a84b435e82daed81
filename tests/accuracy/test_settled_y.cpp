// y at time points behind a switch inside a step, where M leaves y to the dynamics. The truth is exact, or from the
// oracle with located events; neither shares code with the march.

#include "core/accuracy/settled_y.hpp"
#include "core/solve/methods.hpp"
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

// All states and the settled y of a march.
struct Settled {
  Result result;
  RowMatrix y;
};

Settled settled_march(const Scene& scene, Index steps) {
  const auto backend = make_cpu_backend(1);
  Methods methods(scene, *backend, steps, {});
  Settled s;
  methods.run(Method::march, {}, s.result);
  EXPECT_EQ(s.result.status, Status::solved) << s.result.reason;
  s.y = settled_y(methods.problem(), methods.all_states(Method::march, s.result), s.result);
  return s;
}

// At any place of the contact in its step; Radau IIA has 4 (1 - s) for a contact at the part s > 1/3 of its step.
TEST(SettledY, IsExactBehindAContactInsideAStep) {
  for (const double part : {0.1, 0.3, 0.5, 0.7, 0.9}) {
    const Settled s = settled_march(falling(0.5 + part / 10), 10);
    EXPECT_EQ(s.y(5, 0), 0);
    for (Index j = 6; j <= 10; ++j)
      EXPECT_NEAR(s.y(j, 0), 1, 1e-11) << "contact at " << part << " of step 6, row " << j;
    const double stage = s.result.y(6, 0);
    if (part > 1.0 / 3) EXPECT_NEAR(stage, 4 * (1 - part), 1e-9);
    const UnsettledRows rows = unsettled_rows(s.result.y, s.y, 0.04);
    EXPECT_EQ(rows.count, std::abs(stage - 1) > 0.04);
    if (rows.count > 0) EXPECT_EQ(rows.first, 6);
    if (rows.count > 0) EXPECT_NEAR(rows.error, std::abs(stage - 1), 1e-9);
  }
}

// The warning has this error; there is none without a switch, and none for a state at rest, held at zero by terms that
// cancel.
TEST(SettledY, IsToldInTheWarning) {
  const Result r = run(falling(0.55), Method::march, 10);
  EXPECT_NE(r.warning.find("at 1 of 10 time points"), std::string::npos) << r.warning;
  EXPECT_NE(r.warning.find("up to 100 %"), std::string::npos) << r.warning;
  EXPECT_EQ(run(falling(2), Method::march, 10).warning, "");
  for (const Index steps : {10, 16, 100, 700}) {
    const Result rest = run(falling(0), Method::march, steps);
    EXPECT_EQ(rest.status, Status::solved) << rest.reason;
    EXPECT_EQ(rest.warning, "");
  }
}

// Behind an impact y of a brief step is an impulse: no row is settled.
TEST(SettledY, LeavesImpactsAlone) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {0, 0}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  scene.M = Matrix{{0}};
  scene.f = [](double, Eigen::Ref<Vector> f) { f << 0, -1; };
  scene.x0 = Vector{{0.055, 0}};
  scene.T = 1;
  const Settled s = settled_march(scene, 20);
  EXPECT_EQ(distance(s.y, s.result.y), 0);
}

// Random scenes whose M is singular: at all points y is that of the oracle, or `warning` says that it is not.
TEST(SettledY, RandomScenesAreRightOrWarned) {
  int decided = 0, wrong = 0, silent = 0;
  constexpr double certainly_told = 0.1;  // the warning begins at 4 %, by an estimate good to a factor of 2.5
  for (std::uint32_t seed = 51000000; seed < 51000200; ++seed) {
    const oracle::SourceScene s = oracle::source_scene(seed);
    if (is_surely_P(LcpMatrix(s.base.scene.M))) continue;
    const oracle::EventSolution truth = oracle::locate_events(s.base);
    if (!truth.decided || !truth.y_unique || truth.jumps > 0) continue;
    Options options = options_for(Method::march, 100);
    options.states = StateSelection::all;
    const Result r = run(s.scene, options);
    if (r.status != Status::solved) continue;
    ++decided;
    if (oracle::true_error(s, truth, r).largest() <= certainly_told) continue;
    ++wrong;
    silent += r.warning.empty();
  }
  EXPECT_GE(decided, 35);
  EXPECT_GE(wrong, 1);
  EXPECT_EQ(silent, 0);
}

}  // namespace
}  // namespace bromwich

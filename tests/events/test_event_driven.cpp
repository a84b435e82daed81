// Event-driven integration against solutions by hand and the independent event-located oracle.

#include "core/events/event_driven.hpp"
#include "tests/support/random_sources.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

// q' = v, v' = -1 + y, 0 <= y, q >= 0.
Scene ball(double height) {
  Scene scene;
  DenseDynamics d;
  d.A = Matrix::Zero(2, 2);
  d.A(0, 1) = 1;
  d.B = Vector::Unit(2, 1);
  d.N = Vector::Unit(2, 0).transpose();
  scene.dynamics = d;
  scene.M = Matrix(Matrix::Zero(1, 1));
  scene.x0 = Vector::Unit(2, 0) * height;
  scene.f = [](double, Eigen::Ref<Vector> v) {
    v.setZero();
    v[1] = -1;
  };
  scene.T = 3;
  return scene;
}

TEST(EventDriven, ABallComesToRestOnARigidFloor) {
  const Scene scene = ball(0.5);  // lands at t = 1 with v = -1
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  EXPECT_EQ(s.jumps, 1);
  EXPECT_FALSE(s.continuous);
  EXPECT_NEAR(s.x(0.5, true)[0], 0.375, 1e-10);  // EventOptions::tolerance
  EXPECT_NEAR(s.x(2, true).norm(), 0, 1e-9);
  EXPECT_NEAR(s.y(2, true)[0], 1, 1e-9);
  EXPECT_NEAR(s.integral_of_y(3, true)[0], 1 + 2, 1e-9) << "the impulse and the weight";
}

TEST(EventDriven, EndsWithAReason) {
  EventOptions options;
  options.most_work = 1;
  const EventSolution worked = integrate_with_events(ball(0.5), LcpClass::PSD, {}, options);
  EXPECT_FALSE(worked.complete);
  EXPECT_EQ(worked.reason.rfind(out_of_work, 0), 0u) << worked.reason;
  options = {};
  options.interrupted = [] { return true; };
  const EventSolution stopped = integrate_with_events(ball(0.5), LcpClass::PSD, {}, options);
  EXPECT_TRUE(stopped.interrupted);
  EXPECT_FALSE(stopped.complete);
}

TEST(EventDriven, AgreesWithTheOracle) {
  int compared = 0;
  for (std::uint32_t seed = 700; seed < 740; ++seed) {
    const oracle::SourceScene random = oracle::source_scene(seed);
    const oracle::EventSolution truth = oracle::locate_events(random.base);
    if (!truth.decided) continue;
    const oracle::DenseScene& base = random.base.scene;
    Scene scene;
    DenseDynamics d;
    d.A = base.A;
    d.B = base.B;
    d.N = base.N;
    scene.dynamics = d;
    scene.M = base.M;
    scene.f = base.f;
    scene.g = base.g;
    scene.x0 = base.x0;
    scene.T = base.T;
    EventOptions options;
    options.tolerance = 1e-11;
    const EventSolution s = integrate_with_events(scene, base.lcp_class, random.base.breaks, options);
    if (!s.complete) {
      EXPECT_NE(s.reason, "") << seed;
      continue;
    }
    ++compared;
    const Vector size = oracle::measure(truth.largest_x());
    for (int k = 1; k <= 50; ++k) {
      const double t = base.T * (k - 0.381966) / 50;
      EXPECT_LE((s.x(t, true) - truth.x(t, true)).cwiseQuotient(size).cwiseAbs().maxCoeff(), 1e-7) << seed;
    }
  }
  EXPECT_GE(compared, 20);
}

}  // namespace
}  // namespace bromwich

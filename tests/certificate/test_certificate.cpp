#include "core/certificate/certificate.hpp"

#include "core/scene/breakpoints.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/trust.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

Result march(const Scene& scene, Index steps) {
  Options options;
  options.method = Method::march;
  options.steps = steps;
  options.states = StateSelection::all;
  return solve(scene, *make_cpu_backend(1), options);
}

// The truth is that of an oracle that shares no code with the reference of the certificate. Breakpoints of sources that
// are found by their values, and rows at jumps, leave a few differences.
TEST(CertificateOfY, EstimatesTheErrorOfGivenSteps) {
  int compared = 0, near = 0;
  for (std::uint32_t seed = 41000000; seed < 41000080; ++seed) {
    const oracle::SourceScene s = oracle::source_scene(seed);
    const oracle::EventSolution truth = oracle::locate_events(s.base);
    if (!truth.decided) continue;
    const Result r = march(s.scene, 100);
    if (r.status != Status::solved) continue;
    const auto c = certify(s.scene, r, find_breakpoints(s.scene), r.x);
    if (!c) continue;  // the located solution is not the only one
    const double error = oracle::true_error(s, truth, r).x;
    if (!(error > 1e-4)) continue;  // the reference has a tolerance of 1e-7 a step
    ++compared;
    near += std::abs(c->error_of_x - error) < 0.01 * error;
  }
  EXPECT_GE(compared, 30);
  EXPECT_GE(near, 0.9 * compared);
}

// Numbers without units: x, y and t in others give the same ones.
TEST(CertificateOfY, IsThatOfAnyUnits) {
  Certificate first;
  for (const double unit : {1.0, 1e-12, 1e9}) {
    Scene scene;
    scene.T = 1 / unit;
    scene.dynamics = DenseDynamics{Matrix{{-unit}}, Matrix{{unit * unit}}, Matrix{{1}}};
    scene.M = Matrix{{unit}};
    scene.g = [unit](double t, Eigen::Ref<Vector> v) { v[0] = unit * (std::sin(7 * t * unit) - 0.2); };
    scene.x0 = Vector::Constant(1, 0.3 * unit);
    const Result r = march(scene, 20);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    const auto c = certify(scene, r, {}, r.x);
    ASSERT_TRUE(c);
    if (unit == 1) first = *c;
    EXPECT_GT(c->error_of_x, 1e-5);
    EXPECT_NEAR(c->error_of_x / first.error_of_x, 1, 1e-6) << unit;
    EXPECT_NEAR(c->error_of_y / first.error_of_y, 1, 1e-6) << unit;
    EXPECT_NEAR(c->error_of_mean / first.error_of_mean, 1, 1e-6) << unit;
    EXPECT_NEAR(c->mean_defect / first.mean_defect, 1, 1e-6) << unit;
  }
}

// x' = -x + y + 1, w = x + y - 2 from x = 0: y = 2 - x, so x' = 3 - 2x, x = (3 - 3 e^{-2t})/2 up to ln(3)/2, where x =
// 1 and y = 1; both go on. Without y, w is -2 where s = 2 and the state is 1 - e^{-t}.
TEST(CertificateOfY, SeesAYThatIsNoSolution) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{1}};
  scene.f = [](double, Eigen::Ref<Vector> v) { v[0] = 1; };
  scene.g = [](double, Eigen::Ref<Vector> v) { v[0] = -2; };
  scene.x0 = Vector::Zero(1);
  Result r = march(scene, 64);
  const auto right = certify(scene, r, {}, r.x);
  ASSERT_TRUE(right);
  EXPECT_LT(right->largest_defect, 1e-3);
  EXPECT_LT(right->error_of_x, 1e-3);
  r.y.setZero();
  const auto wrong = certify(scene, r, {});
  ASSERT_TRUE(wrong);
  EXPECT_GT(wrong->mean_defect, 0.3);
  // (3 - 3 e^{-2})/2 = 1.297 for 1 - e^{-1} = 0.632: 0.5126 of the larger one.
  EXPECT_NEAR(wrong->error_of_x, 0.5126, 1e-3);
}

// A mass pressed on its stop, x'' = -x - 0.1 x' - 9.81 + y, x >= 0, from rounding: all of x stays rounding.
TEST(CertificateOfY, TakesRoundingAtRestForNoError) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {-1, -0.1}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  scene.M = Matrix{{0}};
  scene.f = [](double, Eigen::Ref<Vector> v) { v << 0, -9.81; };
  scene.T = 0.5;
  for (const Vector& x0 : {Vector{{0, 0}}, Vector{{-1e-16, 0}}, Vector{{-3e-17, 1e-16}}})
    for (const Index steps : {2, 3, 5, 20}) {
      scene.x0 = x0;
      const Result r = march(scene, steps);
      ASSERT_EQ(r.status, Status::solved) << r.reason;
      const auto c = certify(scene, r, {}, r.x);
      ASSERT_TRUE(c);
      EXPECT_LT(c->error_of_x, 1e-3) << steps;
    }
}

// x' = -x + y, 0 <= y, w = x + g >= 0 with g = -1 + 1.5 mod(t, 1/2): x is put back to 1 at each 1/2, the last time at
// T, where a located solution has x = e^{-1/2}. Between them y = 0, and the steps are exact.
TEST(CertificateOfY, LeavesOutARowBehindAJumpAtTheEnd) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{0}};
  scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = -1 + 1.5 * std::fmod(t, 0.5); };
  scene.breakpoints = {0.5, 1, 1.5, 2};
  scene.x0 = Vector::Ones(1);
  scene.T = 2;
  const Result r = march(scene, 128);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.warning, "");
  const auto c = certify(scene, r, scene.breakpoints, r.x);
  ASSERT_TRUE(c);
  EXPECT_LT(c->error_of_x, 1e-3);
}

}  // namespace
}  // namespace bromwich

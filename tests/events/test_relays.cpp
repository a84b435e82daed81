// Relays by event-driven integration: sliding, several at once, and values of y that are not unique.

#include "core/events/event_driven.hpp"
#include "core/scene/relay.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

// x' = -x + 2 lambda, lambda in -Sgn(x - sin t), x(0) = 0: x = sin t slides from the start, where x, its surface and
// all that was seen of them are zero. 2 lambda = cos t + sin t, y_0 = (1 - lambda)/2.
TEST(EventDriven, ARelaySlidesFromTheOrigin) {
  const auto e = [](double t, Eigen::Ref<Vector> v) { v.setConstant(-std::sin(t)); };
  Scene scene = relay_scene(Matrix{{-1}}, Matrix{{2}}, Matrix{{1}}, {}, Vector::Zero(1), e);
  scene.T = 6;
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  for (const double t : {0.5, 2.0, 5.9}) {  // EventOptions::tolerance
    EXPECT_NEAR(s.x(t, true)[0], std::sin(t), 1e-9);
    EXPECT_NEAR(s.y(t, true)[0], 0.5 - (std::cos(t) + std::sin(t)) / 4, 1e-8);
  }
}

// A relay u in sgn x as y_1 = 1 - u: w_1 = x + y_2, w_2 = 2 - y_1. x' = 1/2 - u from 1 reaches 0 at t = 2 and slides
// there with u = 1/2.
TEST(EventDriven, ARelaySlides) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{1, 0}}, Matrix{{1}, {0}}};
  scene.M = Matrix{{0, 1}, {-1, 0}};
  scene.f = [](double, Eigen::Ref<Vector> v) { v[0] = -0.5; };
  scene.g = [](double, Eigen::Ref<Vector> v) { v << 0, 2; };
  scene.x0 = Vector{{1}};
  scene.T = 4;
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  EXPECT_NEAR(s.x(1, true)[0], 0.5, 1e-9);
  EXPECT_NEAR(s.x(3, true)[0], 0, 1e-9);
  EXPECT_NEAR(s.y(3, true)[0], 0.5, 1e-9);
}

// The twisting algorithm x'' = -sgn x - sgn(x') / 2 from (1, 0): half turns shorter by q = 1/sqrt(3) each, which end at
// t = 2 + (2/3 + 2 q) / (1 - q) = 6.31 in the origin.
TEST(EventDriven, TwistingEndsInTheOrigin) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {0, 0}}, Matrix{{0, 0, 0, 0}, {1, 0, 0.5, 0}},
                                 Matrix{{1, 0}, {0, 0}, {0, 1}, {0, 0}}};
  scene.M = Matrix{{0, 1, 0, 0}, {-1, 0, 0, 0}, {0, 0, 0, 1}, {0, 0, -1, 0}};
  scene.f = [](double, Eigen::Ref<Vector> v) { v << 0, -1.5; };
  scene.g = [](double, Eigen::Ref<Vector> v) { v << 0, 2, 0, 2; };
  scene.x0 = Vector{{1, 0}};
  scene.T = 8;
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, {});
  if (!s.complete) {
    EXPECT_GE(s.until, 6) << s.reason;
    return;
  }
  EXPECT_NEAR(s.x(1, true)[0], 0.75, 1e-9);
  EXPECT_NEAR(s.x(2, true)[1], -1, 1e-9);
  EXPECT_LE(s.x(7, true).norm(), 1e-5);
}

// x' = -x + b^T lambda + 0.4 sin 3t from 1, lambda_i in -Sgn(c_i x): x reaches 0 before t = 1 and slides there with
// b^T lambda = -0.4 sin 3t. y_i = (1 - lambda_i) / 2 of least norm is in proportion to b_i, with b^T y = (b^T 1 + 0.4
// sin 3t) / 2, as long as no y_i exceeds 1.
void expect_shared(const Vector& b, const Vector& c) {
  const auto f = [](double t, Eigen::Ref<Vector> v) { v.setConstant(0.4 * std::sin(3 * t)); };
  Scene scene = relay_scene(Matrix{{-1}}, b.transpose(), c, f, Vector::Ones(1));
  scene.T = 3;
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  for (const double t : {1.0, 1.57, 2.1, 2.9}) {
    const Vector y = b * ((b.sum() + 0.4 * std::sin(3 * t)) / (2 * b.squaredNorm()));
    EXPECT_NEAR(s.x(t, true)[0], 0, 1e-9);  // EventOptions::tolerance
    EXPECT_LE((s.y(t, true).head(b.size()) - y).cwiseAbs().maxCoeff(), 1e-8) << "t = " << t;
  }
}

TEST(Relays, OfOneDirectionShareY) {
  expect_shared(Vector{{1, 1}}, Vector{{1, 1}});
  expect_shared(Vector{{1, 1, 1}}, Vector{{1, 1, 1}});
}

// The problems of short steps are not monotone: all sets are tried.
TEST(Relays, OfDifferentGainsShareYInProportion) {
  expect_shared(Vector{{1, 2}}, Vector{{1, 1}});
  expect_shared(Vector{{1, 1}}, Vector{{1, 2}});
}

// Two masses at rest on rough ground, a spring between them: a force on the first grows until it breaks away. The state
// is zero up to then, and rounding of the velocity that stays zero is no motion.
TEST(Relays, AMassBreaksAwayBesideOneAtRest) {
  const Matrix A{{0, 0, 1, 0}, {0, 0, 0, 1}, {-8, 5, 0, 0}, {5, -5, 0, 0}};
  const Matrix B{{0, 0}, {0, 0}, {1, 0}, {0, 1.4}}, C{{0, 0, 1, 0}, {0, 0, 0, 1}};
  const auto f = [](double t, Eigen::Ref<Vector> v) { v << 0, 0, 2 * t, 0; };
  Scene scene = relay_scene(A, B, C, f, Vector::Zero(4));
  scene.T = 0.75;
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, {}, {});
  ASSERT_TRUE(s.complete) << s.reason;
  // q'' = -8 q + 2 (t - 1/2) from t = 1/2, while 5 q < 1.4.
  const double w = std::sqrt(8.0), t = 0.25;
  EXPECT_NEAR(s.x(scene.T, true)[0], 2 * (t - std::sin(w * t) / w) / 8, 1e-9);
  EXPECT_NEAR(s.x(scene.T, true)[3], 0, 1e-12);
}

}  // namespace
}  // namespace bromwich

// Rows between the steps of a march against closed forms.

#include "core/adapted/steps_between.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace bromwich::between_test {
namespace {

// x' = -1 + y, 0 <= y ⊥ x >= 0: x falls to the floor and stays there with y = 1.
Scene falls(double x0) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0.}}, Matrix{{1.}}, Matrix{{1.}}};
  scene.M = Matrix(Matrix::Zero(1, 1));
  scene.f = [](double, Eigen::Ref<Vector> f) { f[0] = -1; };
  scene.x0 = Vector{{x0}};
  scene.T = 3;
  return scene;
}

TEST(StepsBetween, MeetTheFloorWithinAStep) {
  const Scene scene = falls(1);
  const double h = 0.3, begin = 0.9;  // the floor is met at t = 1
  StepsBetween steps(scene, h);
  const Vector x{{0.1}}, y{{0.}};
  const TreeRow* row = steps.at(begin, x, y, 0.05);
  ASSERT_NE(row, nullptr);
  EXPECT_NEAR(row->x[0], 0.05, 1e-14);
  EXPECT_EQ(row->y[0], 0);
  row = steps.at(begin, x, y, 0.25);  // goes on
  ASSERT_NE(row, nullptr);
  EXPECT_NEAR(row->x[0], 0, 1e-14);
  EXPECT_NEAR(row->y[0], 1, 1e-12);
  EXPECT_NEAR(row->integral[0], 0.15, 1e-14);  // x(t) says it: 0.1 - 0.25 + integral = 0
  row = steps.at(begin, x, y, 0.05);           // begins again
  ASSERT_NE(row, nullptr);
  EXPECT_NEAR(row->x[0], 0.05, 1e-14);
}

// x' = -k x + f where f jumps from 0 to 1 inside the step: closed form, also where e^{-kt} is over within the step.
TEST(StepsBetween, BeginShortBehindABreakpoint) {
  for (const double k : {1., 1e4}) {
    Scene scene = falls(1);
    scene.dynamics = DenseDynamics{Matrix{{-k}}, Matrix{{1.}}, Matrix{{1.}}};
    const double jump = 0.37;
    scene.f = [=](double t, Eigen::Ref<Vector> f) { f[0] = t < jump ? 0 : k; };
    scene.breakpoints = {jump};
    StepsBetween steps(scene, 0.1);
    const double begin = 0.3, x_begin = std::exp(-k * begin);
    for (const double s : {0.05, 0.0701, 0.09, 0.1}) {
      const TreeRow* row = steps.at(begin, Vector{{x_begin}}, Vector{{0.}}, s);
      ASSERT_NE(row, nullptr);
      const double t = begin + s, expected = std::exp(-k * t) + (t > jump ? 1 - std::exp(-k * (t - jump)) : 0);
      EXPECT_NEAR(row->x[0], expected, 1e-12) << k << " " << s;
    }
  }
}

TEST(StepsBetween, AreNotForImpacts) {
  Scene scene = falls(1);
  EXPECT_TRUE(StepsBetween::suit(scene));
  scene.restitution = Vector{{0.5}};
  EXPECT_FALSE(StepsBetween::suit(scene));
}

}  // namespace
}  // namespace bromwich::between_test

// Mass matrices that are nearly singular: what rounding makes of the result is in its error estimate.

#include "tests/support/reference.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

using reference::pi;

// E z' = E S z + E (1, 1) y and S = [[0, w], [-w, 0]] with E = [[1, 1], [1, 1 + gap]]: z rotates, and y = 0. The
// entries of E S and of E are rounded, which turns S into another matrix, by about eps/gap.
Scene rotation(double gap) {
  const Matrix E{{1, 1}, {1, 1 + gap}}, S{{0, 2 * pi}, {-2 * pi, 0}};
  Scene scene;
  scene.dynamics = DenseDynamics{E * S, E * Matrix{{1}, {1}}, Matrix{{0, 0}}, E};
  scene.M = Matrix{{1}};
  scene.g = [](double, Eigen::Ref<Vector> v) { v[0] = 1; };
  scene.x0 = Vector{{1, 0}};
  scene.T = 10;
  scene.default_steps = 400;
  return scene;
}

Result solved_to(double tolerance, double gap, Method method = Method::automatic) {
  Options options = options_for(method);
  options.states = StateSelection::all;
  options.tolerance = tolerance;
  return run(rotation(gap), options);
}

double true_error(const Result& r) {
  double error = 0;
  for (Index j = 0; j <= r.steps; ++j)
    error = std::max(
        {error, std::abs(r.x(j, 0) - std::cos(2 * pi * r.t[j])), std::abs(r.x(j, 1) + std::sin(2 * pi * r.t[j]))});
  return error;
}

TEST(MassRounding, IsInTheEstimate) {
  int refused = 0;
  for (const Method method : {Method::automatic, Method::march, Method::events})
    for (const double gap : {1e-3, 1e-9, 1e-11, 1e-12, 1.3e-13}) {
      constexpr double tolerance = 1e-6;
      const Result r = solved_to(tolerance, gap, method);
      if (r.status == Status::solved) {
        EXPECT_LE(true_error(r), tolerance) << gap;
        continue;
      }
      ++refused;
      EXPECT_EQ(r.status, Status::tolerance_not_met);
      EXPECT_NE(r.reason.find("mass matrix E is nearly singular"), std::string::npos) << r.reason;
      ASSERT_TRUE(r.error_estimate);
      EXPECT_GT(*r.error_estimate, tolerance);
      // S changes by up to eps/gap |S|, over T = 10: below 1e-7 nothing is to be refused.
      EXPECT_GT(2.2e-16 / gap * 2 * pi * 10, 1e-7) << gap;
    }
  EXPECT_GE(refused, 3) << "1.3e-13 leaves an error of 1e-3 or so";
}

TEST(MassRounding, DoesNotStandInTheWay) {
  const Result r = solved_to(1e-2, 1e-9);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_TRUE(r.warning.empty()) << r.warning;
}

TEST(MassRounding, IsNamedOnAGivenGrid) {
  Options options = options_for(Method::march, 400);
  options.states = StateSelection::all;
  EXPECT_NE(run(rotation(1.3e-14), options).warning.find("mass matrix E is nearly singular"), std::string::npos);
  EXPECT_TRUE(run(rotation(1e-3), options).warning.empty());
}

// Units of the rows and columns of E are no near singularity.
TEST(MassRounding, UnitsDoNotCount) {
  Scene scene = rotation(0.5);
  const DenseDynamics& d = *scene.dynamics->small_state();
  const Vector rows{{1e-13, 1e9}};
  scene.dynamics = DenseDynamics{rows.asDiagonal() * d.A, rows.asDiagonal() * d.B, d.N, rows.asDiagonal() * d.E};
  Options options = options_for(Method::automatic);
  options.states = StateSelection::all;
  options.tolerance = 1e-6;
  const Result r = run(scene, options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_LE(true_error(r), 1e-6);
}

}  // namespace
}  // namespace bromwich

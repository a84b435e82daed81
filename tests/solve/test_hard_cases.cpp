// Scenes at the limits of the engine: each ends with the right answer or a reason.

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "tests/support/dense_twin.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

// x' = (along ⊕ across) x + B y with general b and n, g(t) = -1 + t.
Scene rectangle(const Vector& b, const Vector& n, double T) {
  Scene scene;
  scene.name = "rectangle";
  scene.dynamics = KroneckerDynamics{{3, 0.25, 0.1}, {b.size(), 0.2, 0.1}, b, n};
  scene.M = Tridiagonal{Vector::Constant(3, -1), Vector::Constant(3, 4), Vector::Constant(3, -1)};
  scene.g = [](double t, Eigen::Ref<Vector> g) { g.setConstant(std::sin(3 * t) - 0.5); };
  scene.x0 = Vector::LinSpaced(3 * b.size(), 0, 1);
  scene.T = T;
  return scene;
}

TEST(HardCases, DiffusionSoFastThatTheKernelIsGoneAfterAStep) {
  for (const double c : {10.0, 100.0, 1e6})
    for (const Method method : {Method::automatic, Method::contour, Method::march, Method::euler}) {
      const Scene scene = make_scene("signorini", {{"Q", 9}, {"c", c}});
      const Result r = run(scene, options_for(method, 100));  // which resolve g
      ASSERT_EQ(r.status, Status::solved) << c << " " << to_string(method) << ": " << r.reason;
      // Quasi-static: W_0 = -N A^{-1} B dominates, y stays below max psi = 4.
      if (c < 1e6) {
        EXPECT_LE(distance(r.y, run(dense_twin(scene), options_for(method, 100)).y), 1e-9)
            << c << " " << to_string(method);
      }
    }
}

TEST(HardCases, ForcedChoicesOfTheKernelStayExact) {
  const Scene scene = rectangle(Vector{{1, 0, 0}}, Vector{{-1, 0, 0}}, 0.3);
  Options options = options_for(Method::march, 3);
  options.tuning.recurrence = RecurrenceChoice::compressed;
  const RowMatrix exact = run(dense_twin(scene), options_for(Method::march, 3)).y;
  EXPECT_LE(distance(run(scene, options).y, exact), 1e-11);
  options = options_for(Method::contour, 3);
  options.tuning.convolution = ConvolutionChoice::scan;
  EXPECT_LE(distance(run(scene, options).y, exact), 1e-10);
}

TEST(HardCases, DrivesThatMissAMode) {
  // b in the middle of a line of five vanishes in the even modes, b = 0 in all.
  for (const Vector& b : {Vector{{0, 0, 1, 0, 0}}, Vector{{1, 1, 1, 1, 1}}, Vector{{0, 0, 0, 0, 0}}}) {
    const Scene scene = rectangle(b, Vector{{-0.5, 0, 0, -0.2, 0}}, 2);
    for (const Method method : {Method::automatic, Method::contour, Method::march, Method::euler}) {
      Options options = options_for(method, 64);
      options.states = StateSelection::all;
      const Result r = run(scene, options), twin = run(dense_twin(scene), options);
      ASSERT_EQ(r.status, Status::solved) << to_string(method) << ": " << r.reason;
      EXPECT_LE(distance(r.y, twin.y), same_problem) << to_string(method);
      EXPECT_LE(distance(r.x, twin.x), same_problem) << to_string(method);
    }
  }
}

Scene sweeping() {  // x' = y - 1, 0 <= y ⊥ x >= 0: y = 1 from t = 1/2 on
  Scene scene;
  scene.name = "sweeping";
  scene.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{0}};
  scene.f = [](double, Eigen::Ref<Vector> f) { f[0] = -1; };
  scene.x0 = Vector{{0.5}};
  scene.T = 1;
  return scene;
}

TEST(HardCases, PiecewiseLinearYWouldRingWhereMIsSingular) {
  EXPECT_EQ(run(sweeping(), options_for(Method::contour, 64)).status, Status::unsupported);
  for (const Method method : {Method::automatic, Method::march, Method::euler}) {
    const Result r = run(sweeping(), options_for(method, 64));
    EXPECT_EQ(r.status, Status::solved);
    EXPECT_TRUE(r.reason.empty());
    EXPECT_NEAR(r.y(64, 0), 1, 1e-12);
    EXPECT_NEAR(r.y(63, 0), 1, 1e-12);
  }
}

TEST(HardCases, AWrongClassIsRefused) {
  Scene scene = sweeping();
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1, 1}}, Matrix{{1}, {1}}};
  scene.M = Matrix{{1, 2}, {2, 1}};
  scene.lcp_class = LcpClass::Z;
  EXPECT_THROW(run(scene, options_for(Method::march, 8)), Error);
}

}  // namespace
}  // namespace bromwich

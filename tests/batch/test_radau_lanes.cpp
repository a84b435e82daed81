// Scenes whose y may jump: steps of Radau IIA side by side in vector lanes, against single solves.

#include "tests/support/batches.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <tuple>

namespace bromwich::batch_test {
namespace {

// A mass on a spring that drops on a rigid floor: M = 0, y acts on the second derivative of w.
Scene floor_contact() {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {-4, -0.3}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  scene.M = Matrix(Matrix::Zero(1, 1));
  scene.x0 = Vector{{1, 0}};
  scene.f = [](double t, Eigen::Ref<Vector> f) { f << 0, 0.3 * std::sin(5 * t); };
  scene.g = [](double, Eigen::Ref<Vector> g) { g << 0.2; };
  scene.T = 4;
  return scene;
}

// Not definite, of no known class; the problems of the steps are of class P.
Scene of_no_class() {
  Scene scene = random_scene(2, 2, 8);
  scene.M = Matrix{{0.05, -1.2}, {1, 0.02}};
  return scene;
}

TEST(BatchRadau, StagesOfRadauAreSteppedInLanes) {
  for (const auto& [scene, steps, name] : {std::tuple(diode_bridge(), Index(400), "diode bridge"),
                                           {floor_contact(), Index(200), "floor"},
                                           {of_no_class(), Index(64), "no class"}}) {
    Batch batch;
    batch.common = scene;
    batch.scenes = 19;
    batch.x0 = around(scene.x0, batch.scenes, 0.1 * scene.x0.cwiseAbs().maxCoeff());
    const BatchResult found = expect_as_single(batch, marched(steps), name);
    EXPECT_GE(2 * found.in_lanes, batch.scenes) << name;
  }
}

TEST(BatchRadau, StagesWithSourcesOfTheirOwn) {
  Batch batch;
  batch.common = floor_contact();
  batch.scenes = 9;
  for (Index k = 0; k < batch.scenes; ++k) {
    const double a = 0.1 * double(k);
    batch.f.push_back([a](double t, Eigen::Ref<Vector> f) { f << 0, a * std::sin(5 * t); });
    batch.g.push_back([a](double, Eigen::Ref<Vector> g) { g << 0.2 + a; });
  }
  const BatchResult found = expect_as_single(batch, marched(200), "own sources");
  EXPECT_GE(2 * found.in_lanes, batch.scenes);
}

}  // namespace
}  // namespace bromwich::batch_test

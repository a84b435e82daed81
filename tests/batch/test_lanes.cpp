// Scenes with a continuous y stepped side by side in vector lanes, against single solves and the dense oracle.

#include "catalogue/catalogue.hpp"
#include "tests/support/batches.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

namespace bromwich::batch_test {
namespace {

TEST(BatchLanes, ScenesThatShareDynamicsAreSteppedInLanes) {
  for (const auto& [name, part] : {std::pair("dlcp-small", 0.003), {"bridge", 0.3}}) {
    Batch batch;
    batch.common = make_scene(name, {});
    batch.scenes = 19;  // two groups of lanes and a part of one
    batch.x0 = around(batch.common.x0, batch.scenes, part);
    const BatchResult found = expect_as_single(batch, marched(128), name);
    EXPECT_EQ(found.in_lanes, batch.scenes) << name;
  }
}

// A contact in the first step is large beside a state at rest, and small beside the one that it moves.
TEST(BatchLanes, ScenesFromRestAreSteppedInLanes) {
  Batch batch;
  batch.common.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  batch.common.M = Matrix{{1}};
  batch.common.g = [](double t, Eigen::Ref<Vector> g) { g[0] = -std::sin(9 * t); };
  batch.common.x0 = Vector::Zero(1);
  batch.common.T = 1;
  batch.scenes = 5;
  batch.x0 = RowMatrix::Zero(batch.scenes, 1);
  EXPECT_EQ(expect_as_single(batch, marched(1000), "rest").in_lanes, batch.scenes);
}

TEST(BatchLanes, EverySizeOfLanes) {
  for (Index n = 1; n <= 8; ++n) {
    Batch batch;
    batch.common = random_scene(n % 5 + 1, n, unsigned(n));
    batch.scenes = 9;
    batch.x0 = around(batch.common.x0, batch.scenes, 0.5, unsigned(n));
    const BatchResult found = expect_as_single(batch, marched(101), "n = " + std::to_string(n));
    EXPECT_EQ(found.in_lanes, batch.scenes) << n;
  }
}

TEST(BatchLanes, LanesAgreeWithTheDenseOracle) {
  const Index J = 40;
  Batch batch;
  batch.common = random_scene(3, 3, 7);
  batch.scenes = 4;
  batch.x0 = around(batch.common.x0, batch.scenes, 0.5);
  const auto backend = make_cpu_backend(1);
  const BatchResult found = solve_batch(batch, *backend, marched(J));
  ASSERT_EQ(found.in_lanes, batch.scenes);
  for (Index k = 0; k < batch.scenes; ++k) {
    const auto scene = oracle::write_out(scene_of(batch, k));
    const auto run = oracle::march(scene, J);
    ASSERT_EQ(run.infeasible, -1);
    EXPECT_LE(apart(found.of(found.y, k), run.y), 1e-11) << k;  // its weights are sums over all lags
  }
}

TEST(BatchLanes, SourcesThatAreRoughAreTakenInParts) {
  Batch batch;
  batch.common = random_scene(2, 2, 3);
  batch.common.f = [](double t, Eigen::Ref<Vector> f) { f << (t < 0.7313 ? 1 : -1), std::max(std::sin(5 * t), 0.0); };
  batch.common.g = [](double t, Eigen::Ref<Vector> g) { g << (t < 1.1 ? 0.4 : -0.6), std::cos(4 * t); };
  batch.common.breakpoints = {0.7313, 1.1};
  batch.scenes = 9;
  batch.x0 = around(batch.common.x0, batch.scenes, 0.5);
  const BatchResult found = expect_as_single(batch, marched(100), "parts");
  EXPECT_EQ(found.in_lanes, batch.scenes);
}

TEST(BatchLanes, SourcesOfTheirOwn) {
  Batch batch;
  batch.common = random_scene(3, 2, 5);
  batch.scenes = 10;
  for (Index k = 0; k < batch.scenes; ++k) {
    const double a = 1 + 0.1 * double(k);
    batch.f.push_back([a](double t, Eigen::Ref<Vector> f) { f << a * std::sin(t), std::cos(a * t), 0.3; });
    batch.breakpoints.push_back(k == 4 ? std::vector<double>{0.8123} : std::vector<double>{});
    if (k == 4)  // with a jump: solved singly
      batch.g.push_back([](double t, Eigen::Ref<Vector> g) { g << (t < 0.8123 ? 0.4 : -0.4), -0.1; });
    else
      batch.g.push_back([a](double t, Eigen::Ref<Vector> g) { g << std::sin(3 * a * t), -0.2 * a; });
  }
  const BatchResult found = expect_as_single(batch, marched(96), "own sources");
  EXPECT_EQ(found.in_lanes, batch.scenes - 1);
}

TEST(BatchLanes, MatricesOfTheirOwnAndListsOfScenes) {
  Batch batch;
  batch.common = random_scene(3, 2, 6);
  batch.scenes = 3;
  std::vector<Scene> list;
  for (Index k = 0; k < batch.scenes; ++k) {
    const Scene other = random_scene(3, 2, unsigned(20 + k));
    const DenseDynamics d = to_dense(other.dynamics);
    batch.A.push_back(d.A), batch.B.push_back(d.B), batch.N.push_back(d.N);
    batch.M.push_back(std::get<Matrix>(other.M));
    batch.E.push_back(Matrix::Identity(3, 3) * (1 + 0.5 * double(k)));
    list.push_back(other);
    list.push_back(other);
    list.back().x0 *= 0.5;
  }
  expect_as_single(batch, marched(64), "own matrices");
  const BatchResult found = expect_as_single(batch_of(list), marched(64), "list");
  EXPECT_EQ(found.in_lanes, 6);
}

TEST(BatchLanes, MatricesOfTheirOwnInLanes) {
  for (const std::string kind : {"continuous", "without f", "stages"}) {
    const bool stages = kind == "stages";
    Batch batch;
    batch.common = stages ? diode_bridge() : random_scene(3, 4, 6);
    if (kind == "without f") batch.common.f = {};
    batch.scenes = 19;
    const DenseDynamics d = to_dense(batch.common.dynamics);
    const Matrix M = std::get<Matrix>(batch.common.M);
    for (Index k = 0; k < batch.scenes; ++k) {
      const double by = 1 + 0.03 * double(k);
      batch.A.push_back(by * d.A), batch.B.push_back(d.B / by), batch.N.push_back(d.N);
      batch.M.push_back(stages ? M : Matrix(M * by));
    }
    batch.x0 = around(batch.common.x0, batch.scenes, 0.02 * batch.common.x0.cwiseAbs().maxCoeff());
    const BatchResult found = expect_as_single(batch, marched(300), kind);
    EXPECT_GE(2 * found.in_lanes, batch.scenes);
  }
}

}  // namespace
}  // namespace bromwich::batch_test

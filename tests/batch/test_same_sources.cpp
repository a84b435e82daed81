// Whole scenes with one f and g, as the scenes of a sweep are: they are stepped as a batch that differs in x0 alone.

#include "batch/batch.hpp"
#include "batch/batch_groups.hpp"
#include "catalogue/catalogue.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <memory>
#include <utility>
#include <vector>

namespace bromwich::same_sources_test {
namespace {

constexpr Index scenes = 11, steps = 128;

// dlcp-small: its sources have kinks, which scenes with sources of their own do not take side by side.
struct Counted {
  Scene scene = make_scene("dlcp-small", {});
  std::shared_ptr<Index> calls = std::make_shared<Index>(0);

  Counted() {
    scene.g = [g = scene.g, calls = calls](double t, Eigen::Ref<Vector> value) {
      ++*calls;
      g(t, value);
    };
  }
};

Batch differing_in_x0(const Scene& common) {
  Batch batch;
  batch.common = common;
  batch.scenes = scenes;
  batch.x0 = common.x0.transpose().replicate(scenes, 1);
  for (Index k = 0; k < scenes; ++k) batch.x0.row(k) *= 1 + 2e-4 * double(k);
  return batch;
}

Batch written_out_as_scenes(const Batch& batch) {
  std::vector<Scene> all;
  for (Index k = 0; k < batch.scenes; ++k) all.push_back(scene_of(batch, k));
  return batch_of(std::move(all));
}

TEST(SameSources, AreSteppedSideBySideAndSampledOnce) {
  const Counted counted;
  const Batch batch = differing_in_x0(counted.scene);
  Batch whole = written_out_as_scenes(batch);
  const auto backend = make_cpu_backend(1);
  const BatchResult expected = solve_batch(batch, *backend, marched(steps));
  const Index calls_of_batch = std::exchange(*counted.calls, 0);
  whole.same_sources = true;
  const BatchResult found = solve_batch(whole, *backend, marched(steps));
  EXPECT_LE(*counted.calls, calls_of_batch);
  EXPECT_EQ(found.in_lanes, scenes);
  EXPECT_EQ(found.status, expected.status);
  EXPECT_EQ(found.warning, expected.warning);
  EXPECT_TRUE(found.y == expected.y && found.w == expected.w && found.x == expected.x);
}

TEST(SameSources, AreThoseOfEachSceneWhereItSaysNothing) {
  const Counted counted;
  Batch whole = written_out_as_scenes(differing_in_x0(counted.scene));
  EXPECT_TRUE(own_sources(whole));
  whole.same_sources = true;
  EXPECT_FALSE(own_sources(whole));
  whole.own.back().T = 0.5;  // other time points
  EXPECT_TRUE(own_sources(whole));
}

// Blocks are parts of the same kind.
TEST(SameSources, InBlocks) {
  const Counted counted;
  Batch whole = written_out_as_scenes(differing_in_x0(counted.scene));
  whole.same_sources = true;
  const auto backend = make_cpu_backend(1);
  Options options = marched(steps);
  options.memory_limit = predicted_bytes(whole, options, 4, 1) + 1;
  Index in_lanes = 0;
  EXPECT_EQ(solve_in_blocks(whole, *backend, options, [&](Index, const BatchResult& r) { in_lanes += r.in_lanes; }), 3);
  EXPECT_EQ(in_lanes, scenes);
}

}  // namespace
}  // namespace bromwich::same_sources_test

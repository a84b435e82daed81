// Batches as a whole: doubts, failures, blocks, interrupts, given times and bad input.

#include "batch/batch.hpp"
#include "catalogue/catalogue.hpp"
#include "core/solve/dense_output.hpp"
#include "tests/support/batches.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <string>

namespace bromwich::batch_test {
namespace {

// An oscillation that 24 steps do not resolve: a single solve refuses it, and so does the batch.
TEST(Batch, WhatASingleSolveDoubtsIsNotCalledSolved) {
  Batch batch;
  batch.common = make_scene("bridge", {});
  batch.scenes = 9;
  batch.x0 = around(batch.common.x0, batch.scenes, 0.5);
  for (const Index steps : {5, 12, 24, 48}) expect_as_single(batch, marched(steps), std::to_string(steps) + " steps");
}

TEST(Batch, OneSceneThatFailsSpoilsNothing) {
  Batch batch;
  batch.common = make_scene("dlcp-small", {});
  batch.scenes = 12;
  batch.x0 = around(batch.common.x0, batch.scenes, 0.003);
  const Options options = marched(64);
  const auto backend = make_cpu_backend(2);
  const BatchResult all = solve_batch(batch, *backend, options);
  batch.x0.row(3) << 5, 5, 5;  // the constraints have no solution at t = 0
  batch.x0(7, 1) = std::numeric_limits<double>::quiet_NaN();
  const BatchResult found = solve_batch(batch, *backend, options);
  EXPECT_EQ(found.status[3], solve(scene_of(batch, 3), *backend, options).status);
  EXPECT_NE(found.status[3], Status::solved);
  EXPECT_EQ(found.status[7], Status::unsupported);
  EXPECT_EQ(found.reason[7].rfind("x0: entry", 0), 0u) << found.reason[7];
  EXPECT_TRUE(found.of(found.y, 7).array().isNaN().all());
  EXPECT_EQ(found.solved(), 10);
  for (const Index k : {0, 1, 2, 4, 5, 6, 8, 9, 10, 11})
    EXPECT_EQ(apart(found.of(found.y, k), all.of(all.y, k)), 0) << k;  // the lanes do not mix
}

TEST(Batch, BlocksAreTheWhole) {
  Batch batch;
  batch.common = random_scene(2, 2, 9);
  batch.scenes = 50;
  batch.x0 = around(batch.common.x0, batch.scenes, 0.5);
  Options options = marched(64);
  const auto backend = make_cpu_backend(1);
  const BatchResult whole = solve_batch(batch, *backend, options);
  options.memory_limit = predicted_bytes(batch, options, 20);
  EXPECT_EQ(refusal([&] { solve_batch(batch, *backend, options); }).rfind("memory_limit: 50 scenes are predicted", 0),
            0u);
  Index next = 0, reported = 0;
  options.progress = [&](const Progress& p) {
    EXPECT_GE(p.iteration, reported);
    EXPECT_EQ(p.total, 50);
    reported = p.iteration;
  };
  const Index blocks = solve_in_blocks(batch, *backend, options, [&](Index first, const BatchResult& block) {
    ASSERT_EQ(first, next);
    next += block.scenes;
    EXPECT_LE(apart(block.y, whole.y.middleRows(first * whole.rows(), block.scenes * whole.rows())), same);
  });
  EXPECT_EQ(blocks, 3);
  EXPECT_EQ(next, 50);
  EXPECT_EQ(reported, 50);
}

TEST(Batch, Interrupted) {
  Batch batch;
  batch.common = random_scene(2, 2, 9);
  batch.scenes = 400;
  batch.x0 = around(batch.common.x0, batch.scenes, 0.5);
  Options options = marched(16);
  options.interrupted = [] { return true; };
  const auto backend = make_cpu_backend(1);
  const BatchResult found = solve_batch(batch, *backend, options);
  EXPECT_GT(found.solved(), 0);
  EXPECT_EQ(found.status.back(), Status::interrupted);
  EXPECT_TRUE(found.of(found.y, 399).array().isNaN().all());
}

TEST(Batch, RowsAtGivenTimes) {
  Batch batch;
  batch.common = random_scene(3, 2, 5);
  batch.scenes = 3;
  batch.x0 = around(batch.common.x0, batch.scenes, 0.5);
  batch.times = {0, 0.313, 2};
  const auto backend = make_cpu_backend(1);
  for (const double tolerance : {0.0, 1e-4}) {
    Options options = marched(tolerance > 0 ? 0 : 64);
    options.tolerance = tolerance;
    const BatchResult found = solve_batch(batch, *backend, options);
    ASSERT_EQ(found.rows(), 3);
    for (Index k = 0; k < batch.scenes; ++k) {
      const Scene scene = scene_of(batch, k);
      const Result one = at_times(scene, *backend, solve(scene, *backend, options), batch.times);
      EXPECT_EQ(found.status[std::size_t(k)], Status::solved);
      EXPECT_LE(apart(found.of(found.y, k), one.y), same);
      EXPECT_LE(apart(found.of(found.x, k), one.x), same);
      EXPECT_LE(apart(found.of(found.w, k), slack(scene, one)), same);
    }
  }
}

TEST(Batch, BadInputIsRefused) {
  const auto backend = make_cpu_backend(1);
  Batch batch;
  batch.common = random_scene(2, 2, 9);
  batch.scenes = 3;
  const auto said = [&](const Batch& b, const Options& options = {}) {
    return refusal([&] { solve_batch(b, *backend, options); });
  };
  Batch b = batch;
  b.x0 = RowMatrix::Zero(2, 2);
  EXPECT_EQ(said(b), "x0: is 2 x 2; make it scenes x states = 3 x 2");
  b = batch;
  b.M.assign(2, Matrix::Identity(2, 2));
  EXPECT_EQ(said(b), "M: has 2 entries; give 3, one per scene, or none");
  b.M.assign(3, Matrix::Identity(3, 3));
  EXPECT_EQ(said(b), "M of scene 0: is 3 x 3; make it the shape that all scenes have = 2 x 2");
  b = batch;
  b.scenes = 0;
  EXPECT_EQ(said(b), "scenes: is 0; give at least one scene");
  EXPECT_EQ(said(batch_of({random_scene(2, 2, 1), random_scene(3, 2, 1)})),
            "states: is 3 in scene 1; give 2 as in scene 0: all have one structure");
  Options options;
  options.tolerance = 1e-4;
  EXPECT_EQ(said(batch, options),
            "tolerance: is given to a batch without times; give times, at which all scenes have rows");
  b = batch;
  b.times = {0, 3};
  EXPECT_EQ(said(b), "times: has 3 at 1; give times in order, from 0 to T = 2");
  options = {};
  options.states = StateSelection::list;
  options.components = {2};
  EXPECT_EQ(said(batch, options), "states: component 2 of 2; components are counted from 0");
  b = batch;
  b.common.M = Matrix(Matrix::Identity(3, 3));
  EXPECT_EQ(said(b).rfind("M: is 3 x 3", 0), 0u);
}

}  // namespace
}  // namespace bromwich::batch_test

// Batches that a user stops: how soon, and what is kept.

#include "batch/stopped_batch.hpp"

#include "cpu/cpu_backend.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

namespace bromwich::stopped_test {
namespace {

// Scenes that share their dynamics, and are stepped in lanes.
Batch many_scenes(Index count) {
  reference::Random random(9);
  Batch batch;
  Scene& s = batch.common;
  s.dynamics =
      DenseDynamics{random.matrix(2, 2) - 2 * Matrix::Identity(2, 2), random.matrix(2, 2), random.matrix(2, 2)};
  s.M = Matrix(4 * Matrix::Identity(2, 2) + random.matrix(2, 2));
  s.lcp_class = LcpClass::P;
  s.g = [](double t, Eigen::Ref<Vector> v) { v.setConstant(std::sin(3 * t) - 0.2); };
  s.breakpoints_are_all = true;
  s.x0 = random.vector(2);
  s.T = 1;
  batch.scenes = count;
  batch.x0 = random.matrix(count, 2);
  return batch;
}

Options steps(Index J) {
  Options options;
  options.method = Method::march;
  options.steps = J;
  options.states = StateSelection::all;
  return options;
}

Index last_solved(const BatchResult& r) {
  Index last = -1;
  for (Index k = 0; k < r.scenes; ++k)
    if (r.status[std::size_t(k)] == Status::solved) last = k;
  return last;
}

// Rows of scenes that were not reached are made on request: to write them takes as long as scenes do.
TEST(StoppedBatch, HasNoRowsOfOtherScenes) {
  const Batch batch = many_scenes(4000);
  const auto backend = make_cpu_backend(1);
  Options options = steps(16);
  int asked = 0;
  options.interrupted = [&] { return ++asked > 2; };
  BatchResult found = solve_batch_until_stopped(batch, *backend, options);
  const Index kept = last_solved(found) + 1, rows = found.rows();
  ASSERT_TRUE(kept > 0 && kept < batch.scenes) << kept;
  EXPECT_EQ(found.y.rows(), kept * rows);
  EXPECT_EQ(found.x.rows(), kept * rows);
  EXPECT_EQ(found.w.rows(), 0);
  EXPECT_EQ(found.status.back(), Status::interrupted);
  const BatchResult whole = solve_batch(batch, *backend, steps(16));
  for (Index k = 0; k < kept; ++k)
    if (found.status[std::size_t(k)] == Status::solved) {
      ASSERT_EQ(found.of(found.y, k), whole.of(whole.y, k)) << k;
    }
  add_missing_rows(found);
  ASSERT_EQ(found.y.rows(), batch.scenes * rows);
  ASSERT_EQ(found.x.rows(), batch.scenes * rows);
  EXPECT_EQ(found.w.rows(), 0);
  EXPECT_TRUE(found.y.bottomRows((batch.scenes - kept) * rows).array().isNaN().all());
  EXPECT_EQ(found.of(found.y, last_solved(found)), whole.of(whole.y, last_solved(found)));
}

TEST(StoppedBatch, IsWholeWithoutAnInterruption) {
  const Batch batch = many_scenes(40);
  const auto backend = make_cpu_backend(1);
  BatchResult found = solve_batch_until_stopped(batch, *backend, steps(16));
  const BatchResult whole = solve_batch(batch, *backend, steps(16));
  EXPECT_EQ(found.solved(), 40);
  EXPECT_EQ(found.y, whole.y);
  add_missing_rows(found);
  EXPECT_EQ(found.y, whole.y);
}

TEST(StoppedBatch, StopsBeforeTheFirstScene) {
  const Batch batch = many_scenes(4000);
  const auto backend = make_cpu_backend(1);
  Options options = steps(16);
  options.interrupted = [] { return true; };
  BatchResult found = solve_batch_until_stopped(batch, *backend, options);
  EXPECT_LE(found.y.rows(), 128 * found.rows()) << "those between two questions";
  add_missing_rows(found);
  EXPECT_EQ(found.y.rows(), batch.scenes * found.rows());
}

// Scenes of many steps: a few between two questions, about 2^21 steps a thread.
TEST(StoppedBatch, AsksOftenWithManySteps) {
  const Batch batch = many_scenes(64);
  const auto backend = make_cpu_backend(1);
  Options options = steps(Index(1) << 17);
  options.states = StateSelection::none;
  int asked = 0;
  options.interrupted = [&] { return ++asked > 1; };
  EXPECT_LE(solve_batch(batch, *backend, options).solved(), 2 * (1 << 21) / (1 << 17));
}

// Functions of the user may take long: they are not called for all scenes before the first question.
TEST(StoppedBatch, AsksBetweenSourcesOfScenes) {
  Batch batch = many_scenes(64);
  Index calls = 0;
  batch.g.assign(64, [&calls](double, Eigen::Ref<Vector> v) {
    ++calls;
    v.setOnes();
  });
  batch.breakpoints_are_all = true;
  Options options = steps(1000);
  options.interrupted = [] { return true; };
  const auto backend = make_cpu_backend(1);
  EXPECT_EQ(solve_batch(batch, *backend, options).solved(), 0);
  EXPECT_LE(calls, 16 * 1001) << "of a few scenes; all would be 64 x 1001";
}

}  // namespace
}  // namespace bromwich::stopped_test

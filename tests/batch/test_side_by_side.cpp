// Scenes solved by several threads at once, against single solves of the same scenes.

#include "batch/side_by_side.hpp"

#include "batch/single_solves.hpp"
#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/solve/cost.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/mechanics/structures.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <thread>

namespace bromwich::side_by_side_test {
namespace {

constexpr Index steps = 64;

Options with(Method method) {
  Options options;
  options.method = method;
  options.steps = steps;
  return options;
}

// Membranes of 7 points on the side, which lanes do not take.
Batch with_own_matrices(Index count) {
  std::vector<Scene> scenes;
  for (Index k = 0; k < count; ++k)
    scenes.push_back(make_scene("signorini", {{"Q", 7}, {"c", 0.05 * (1 + 0.1 * double(k))}}));
  return batch_of(std::move(scenes));
}

Batch with_shared_matrices(Index count) {
  Batch batch;
  batch.common = make_scene("signorini", {{"Q", 7}});
  batch.scenes = count;
  batch.x0.resize(count, batch.common.states());
  for (Index k = 0; k < count; ++k) batch.x0.row(k) = (1 + 0.1 * double(k)) * batch.common.x0.transpose();
  return batch;
}

std::shared_ptr<Backend> one_thread() { return make_cpu_backend(1); }

// Another number of threads may change the order of a sum, and nothing else.
void expect_as_single(const Batch& batch, const Options& options, const BatchResult& found) {
  const auto backend = one_thread();
  for (Index k = 0; k < batch.scenes; ++k) {
    const Result one = solve(scene_of(batch, k), *backend, options);
    EXPECT_EQ(found.status[std::size_t(k)], one.status) << k << ": " << one.reason;
    EXPECT_EQ(found.method[std::size_t(k)], one.method) << k;
    const double largest = one.y.cwiseAbs().maxCoeff();
    EXPECT_GT(largest, 0) << k;
    EXPECT_LE((found.of(found.y, k) - one.y).cwiseAbs().maxCoeff(), 1e-12 * largest) << k;
  }
}

TEST(SideBySide, ScenesWithMatricesOfTheirOwn) {
  const auto backend = make_cpu_backend(3);
  const Batch batch = with_own_matrices(7);
  for (const Method method : {Method::march, Method::multigrid}) {
    std::atomic<int> made = 0;
    const BatchResult found = solve_batch(batch, *backend, with(method), [&] {
      ++made;
      return one_thread();
    });
    EXPECT_EQ(made, 3);
    EXPECT_EQ(found.solved(), batch.scenes);
    expect_as_single(batch, with(method), found);
  }
}

TEST(SideBySide, EachThreadPreparesSharedMatricesOnce) {
  const auto backend = make_cpu_backend(2);
  const Batch batch = with_shared_matrices(9);
  const BatchResult found = solve_batch(batch, *backend, with(Method::march), one_thread);
  EXPECT_EQ(found.in_lanes, 0);
  EXPECT_GE(found.prepared, 7);  // a first solve of each thread at most is not prepared
  expect_as_single(batch, with(Method::march), found);
}

TEST(SideBySide, OneSceneThatFailsSpoilsNothing) {
  const auto backend = make_cpu_backend(2);
  Batch batch = with_own_matrices(6);
  batch.own[2].x0[0] = std::numeric_limits<double>::quiet_NaN();
  const BatchResult found = solve_batch(batch, *backend, with(Method::march), one_thread);
  EXPECT_EQ(found.status[2], Status::unsupported);
  EXPECT_EQ(found.reason[2].rfind("x0: entry", 0), 0u) << found.reason[2];
  EXPECT_TRUE(found.of(found.y, 2).array().isNaN().all());
  EXPECT_EQ(found.solved(), 5);
}

// Functions of the caller run on its own thread, and each scene is counted.
TEST(SideBySide, ProgressComesFromTheCallingThread) {
  const auto backend = make_cpu_backend(2);
  Options options = with(Method::march);
  Index last = 0;
  const auto here = std::this_thread::get_id();
  options.progress = [&](const Progress& p) {
    EXPECT_EQ(std::this_thread::get_id(), here);
    EXPECT_GE(p.iteration, last);
    EXPECT_EQ(p.total, 8);
    last = p.iteration;
  };
  options.interrupted = [&] {
    EXPECT_EQ(std::this_thread::get_id(), here);
    return false;
  };
  solve_batch(with_own_matrices(8), *backend, options, one_thread);
  EXPECT_EQ(last, 8);
}

TEST(SideBySide, AnInterruptEndsAllThreads) {
  const auto backend = make_cpu_backend(2);
  Options options = with(Method::march);
  options.steps = 200000;  // seconds for all scenes, and the first poll comes after 50 ms
  options.interrupted = [] { return true; };
  const BatchResult found = solve_batch(with_own_matrices(20), *backend, options, one_thread);
  EXPECT_EQ(found.solved(), 0);
  EXPECT_EQ(found.status.front(), Status::interrupted);
  EXPECT_EQ(found.status.back(), Status::interrupted);
}

TEST(SideBySide, ErrorsOfTheMachineAndOfTheCallerLeaveTheCall) {
  const auto backend = make_cpu_backend(2);
  const Batch batch = with_own_matrices(4);
  const auto broken = []() -> std::shared_ptr<Backend> { throw Error("backend", "is gone", "", ErrorKind::device); };
  EXPECT_EQ(refusal([&] { solve_batch(batch, *backend, with(Method::march), broken); }).rfind("backend: is gone", 0),
            0u);
  Options options = with(Method::march);
  options.progress = [](const Progress&) { throw std::runtime_error("stop"); };
  EXPECT_THROW(solve_batch(batch, *backend, options, one_thread), std::runtime_error);
}

// The limit holds one scene, and not two: they are solved one after the other.
TEST(SideBySide, ScenesThatDoNotFitTogetherAreSolvedAlone) {
  const auto backend = make_cpu_backend(2);
  const Batch batch = with_own_matrices(3);
  Options options = with(Method::march);
  options.memory_limit = 1.5 * predicted_cost(scene_of(batch, 0), Method::march, steps, 0).bytes;
  int made = 0;
  const BatchResult found = solve_batch(batch, *backend, options, [&] {
    ++made;
    return one_thread();
  });
  EXPECT_EQ(made, 0);
  EXPECT_EQ(found.solved(), 3);
}

// What does not fit beside others is left to the caller, who solves it alone.
TEST(SideBySide, ASceneThatDoesNotFitBesideOthersIsLeft) {
  const Batch batch = with_own_matrices(2);
  BatchResult result;
  Options options = with(Method::march);
  options.memory_limit = 1;
  SideBySide both(batch, options, result, one_thread, 2);
  Index done = 0;
  both.take(
      {0, 1}, false, [&](Index) { ++done; }, [] {});
  EXPECT_EQ(done, 0);
}

// Contacts are marched as a single solve does it, without the located solution that it compares with.
TEST(SingleSolves, ContactsOfABatchAreThoseOfSingleSolves) {
  const auto backend = one_thread();
  Options options = with(Method::march);
  options.steps = 800;
  options.states = StateSelection::all;
  std::vector<Scene> scenes;
  for (std::uint32_t seed = 0; seed < 24; ++seed) {
    const DrawnStructure drawn = random_structure(seed, 2, 1, false, {0.1, 0.2, 0.4});
    scenes.push_back(make_mechanism(drawn.structure, drawn.contacts).scene);
  }
  const BatchResult found = solve_batch(batch_of(scenes), *backend, options);
  Index compared = 0;
  for (Index k = 0; k < found.scenes; ++k) {
    const Result one = solve(scenes[std::size_t(k)], *backend, options);
    if (one.status != Status::solved) continue;
    ++compared;
    ASSERT_EQ(found.status[std::size_t(k)], Status::solved) << k << ": " << found.reason[std::size_t(k)];
    EXPECT_EQ(RowMatrix(found.of(found.x, k)), one.x) << k;
    EXPECT_EQ(RowMatrix(found.of(found.y, k)), one.y) << k;
  }
  EXPECT_GE(compared, 20);
}

TEST(SingleSolves, ContactsOfABatchTakeSourcesAtTheirSteps) {
  const auto calls = std::make_shared<std::atomic<Index>>(0);
  Structure s = block(1.3, 10);
  s.f = [calls, f = s.f](double t, Eigen::Ref<Vector> value) {
    ++*calls;
    f(t, value);
  };
  Options options = with(Method::march);
  options.steps = 400;
  std::vector<Scene> scenes;
  for (const double mu : {0.2, 0.3, 0.4}) {
    Contact c = belt(0.5);
    c.mu = mu;
    scenes.push_back(make_mechanism(s, {c}).scene);
  }
  const BatchResult found = solve_batch(batch_of(scenes), *one_thread(), options);
  EXPECT_EQ(found.solved(), 3);
  // At the ends and in the middle of each step, and for natural units, residuals and rows of sources.
  EXPECT_LE(*calls, 3 * 8 * options.steps);
}

}  // namespace
}  // namespace bromwich::side_by_side_test

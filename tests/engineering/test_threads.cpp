// Solves on several threads against the same solves on one. With the contract tests of the backend (test_backend*.cpp,
// 1, 2 and 7 threads) this is the program for the thread sanitizer (scripts/check tsan): together they give every
// parallel loop of cpu/ work for several threads.
//
// loops                                     scene here
// resolvent: grid lines, dense, sparse      signorini; the same with A dense (25 states); with A sparse (1521 states)
// sine transforms by products               signorini (those by FFT take 1100 constraints: contract tests)
// scan: modes, chunks of time, dense chunks signorini with 39 and with 15 constraints; dense
// convolution by FFT: modal, dense          signorini; dense
// LCP batch, residual                       all
// marching: modes of a step                 signorini with 263 constraints: 264 x 263 exponentials >= 2^16
// marching on lags: levels by FFT           sparse: 39 constraints x 1024 lags >= 2^15

#include "catalogue/catalogue.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

namespace bromwich {
namespace {

constexpr int many = 4;

Scene heat(double Q) { return make_scene("signorini", {{"Q", Q}}); }

Scene dense_heat() {
  Scene scene = heat(5);
  scene.dynamics = to_dense(scene.dynamics);
  return scene;
}

Scene sparse_heat() {
  Scene scene = heat(39);
  scene.dynamics = to_sparse(get<KroneckerDynamics>(scene.dynamics));
  return scene;
}

/// Threads only change the order of sums, so both are solutions of one discrete problem.
void expect_same_on_many(const Scene& scene, const Options& options) {
  const Result one = run(scene, options);
  const auto backend = make_cpu_backend(many);
  const Result result = solve(scene, *backend, options);
  ASSERT_EQ(one.status, Status::solved) << one.reason;
  EXPECT_EQ(result.status, Status::solved) << result.reason;
  EXPECT_LE(distance(result.y, one.y), same_problem);
}

Options contour(Index steps, ConvolutionChoice convolution) {
  Options options = options_for(Method::contour, steps);
  options.tuning.convolution = convolution;
  return options;
}

TEST(Threads, ScanOfModes) { expect_same_on_many(heat(39), contour(400, ConvolutionChoice::scan)); }

TEST(Threads, ScanOfChunksOfTime) { expect_same_on_many(heat(15), contour(2000, ConvolutionChoice::scan)); }

TEST(Threads, ScanOfADenseState) { expect_same_on_many(dense_heat(), contour(1000, ConvolutionChoice::scan)); }

TEST(Threads, FftOfModes) { expect_same_on_many(heat(39), contour(400, ConvolutionChoice::fft)); }

TEST(Threads, FftOfADenseKernel) { expect_same_on_many(dense_heat(), contour(400, ConvolutionChoice::fft)); }

TEST(Threads, MarchOverModes) {
  Options options = options_for(Method::march, 24);
  options.tuning.recurrence = RecurrenceChoice::modal;
  expect_same_on_many(heat(263), options);
}

TEST(Threads, MarchOnLagsOfASparseScene) { expect_same_on_many(sparse_heat(), options_for(Method::march, 2200)); }

}  // namespace
}  // namespace bromwich

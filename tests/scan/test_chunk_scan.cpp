// Newton's method on the states between chunks, on chains of maps whose solution is computed one map after another.

#include "core/scan/chunk_scan.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <vector>

namespace bromwich {
namespace {

/// x+ = step(x) with its derivative, `length` times in each chunk.
struct Scalar final : Chunks {
  Index chunks = 1, length = 1;
  std::function<double(double)> step, slope;
  std::function<bool(double)> solvable = [](double) { return true; };
  std::vector<Index> marched;

  Index count() const override { return chunks; }
  ChunkEnd march(Index c, const Vector& start, bool with_derivative) override {
    ++marched[std::size_t(c)];
    double x = start[0], D = 1, size = 0;
    std::uint64_t sets = 0;
    for (Index k = 0; k < length; ++k) {
      if (!solvable(x)) return {};
      D *= slope(x);
      sets = 2 * sets + (slope(x) > 1);
      x = step(x);
      size = std::max(size, std::abs(x));
    }
    ChunkEnd end{Vector::Constant(1, x), Vector::Constant(1, size), Matrix(), sets, true};
    if (with_derivative) end.D = Matrix::Constant(1, 1, D);
    return end;
  }
  ScanReport run(double x0, double guess) {
    marched.assign(std::size_t(chunks), 0);
    std::vector<Vector> starts(std::size_t(chunks), Vector::Constant(1, guess));
    starts[0][0] = x0;
    return solve_chunks(*this, starts, length, HostThreads(), SharedStop({}));
  }
};

TEST(ChunkScan, AffineMapsTakeTwoPasses) {
  Scalar chain;
  chain.chunks = 50, chain.length = 3;
  chain.step = [](double x) { return 0.9 * x + 1; };
  chain.slope = [](double) { return 0.9; };
  const ScanReport report = chain.run(-20, 3);
  // The first correction is exact, and the second pass finds nothing left.
  EXPECT_EQ(report.passes, 2);
  EXPECT_EQ(report.in_turn, 0);
  EXPECT_EQ(chain.marched[0], 1);  // begins with the given state
}

TEST(ChunkScan, SmoothMapsConvergeQuadratically) {
  Scalar chain;
  chain.chunks = 20;
  chain.step = [](double x) { return x - 0.1 * std::sin(x) + 0.05; };
  chain.slope = [](double x) { return 1 - 0.1 * std::cos(x); };
  const ScanReport report = chain.run(2, 1);
  ASSERT_GE(report.history.size(), 4u);
  // With delta of size e the next one is at most of the size of e^2 times the sum of all second derivatives, 0.1 each.
  for (std::size_t k = 1; k + 1 < report.history.size(); ++k)
    EXPECT_LE(report.history[k + 1], 2.0 * report.history[k] * report.history[k] + 1e-13);
  EXPECT_LE(report.passes, 7);
}

// The logistic map at 4 doubles every perturbation: corrections that are linear lead nowhere.
TEST(ChunkScan, ChaosEndsInTurn) {
  Scalar chain;
  chain.chunks = 200, chain.length = 4;
  chain.step = [](double x) { return 4 * x * (1 - x); };
  chain.slope = [](double x) { return 4 - 8 * x; };
  const ScanReport report = chain.run(0.3, 0.5);
  EXPECT_EQ(report.stopped, -1);
  EXPECT_GT(report.in_turn, 100);
  EXPECT_LE(report.passes, 40);
  for (const Index times : chain.marched) EXPECT_GE(times, 1);
}

TEST(ChunkScan, OneMoreChunkIsFinalWithEveryPass) {
  Scalar chain;
  chain.chunks = 6;
  // Derivatives that say nothing: only what follows from the front is right.
  chain.step = [](double x) { return std::cos(3 * x); };
  chain.slope = [](double) { return 0.0; };
  const ScanReport report = chain.run(0.7, 0.1);
  EXPECT_LE(report.passes + report.in_turn, 6 + 6);
  // s_c is exact after c passes, and its chunk is marched once more at most.
  for (Index c = 0; c < 6; ++c) EXPECT_LE(chain.marched[std::size_t(c)], c + 1);
}

TEST(ChunkScan, StopsWhereTheMarchDoes) {
  Scalar chain;
  chain.chunks = 10;
  chain.step = [](double x) { return x + 1; };
  chain.slope = [](double) { return 1.0; };
  chain.solvable = [](double x) { return x < 6.5; };  // of 0, 1, ..: chunk 7 has no end
  EXPECT_EQ(chain.run(0, 0).stopped, 7);
  EXPECT_EQ(chain.run(0, 100).stopped, 7);  // first states without a march
}

TEST(ChunkScan, RowsOfChunks) {
  EXPECT_EQ(first_rows(3, 10), (std::vector<Index>{0, 3, 6, 10}));
  const HostThreads alone;
  ScanPlan plan;
  plan.threads = &alone;
  EXPECT_EQ(chunks_of(plan, 5), 1);
  plan.chunks = 9;
  EXPECT_EQ(chunks_of(plan, 5), 5);
}

}  // namespace
}  // namespace bromwich

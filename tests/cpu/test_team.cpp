// Loops shared by threads (cpu/team.hpp).

#include "cpu/team.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cstdlib>
#include <numeric>
#include <stdexcept>
#include <thread>
#include <vector>

namespace bromwich::cpu {
namespace {

constexpr std::array<int, 3> thread_counts{1, 2, 7};

// Scratch memory of a thread is used by one call at a time.
TEST(Team, CallsEachIndexOnce) {
  for (const int threads : thread_counts) {
    Team team(threads);
    EXPECT_EQ(team.threads(), threads);
    for (const Index count : {0, 1, 2, 7, 64, 1009})
      for (int round = 0; round < 50; ++round) {
        std::vector<int> calls(std::size_t(count), 0);
        std::array<std::atomic<bool>, 7> in_use{};
        std::atomic<int> clashes = 0;
        team.share(count, [&](Index i, int thread) {
          std::atomic<bool>& mine = in_use.at(std::size_t(thread));
          clashes += mine.exchange(true);
          ++calls[std::size_t(i)];
          mine = false;
        });
        ASSERT_EQ(calls, std::vector<int>(std::size_t(count), 1)) << threads << " threads, round " << round;
        ASSERT_EQ(clashes, 0);
      }
  }
}

TEST(Team, RangesPartitionTheIndices) {
  for (const int threads : thread_counts)
    for (const bool enough : {false, true})
      for (const Index count : {0, 1, 5, 8, 127}) {
        Team team(threads);
        std::vector<int> calls(std::size_t(count), 0);
        std::atomic<int> ranges = 0;
        team.ranges(count, enough, [&](Index begin, Index end) {
          ++ranges;
          EXPECT_LT(begin, end);
          for (Index i = begin; i < end; ++i) ++calls[std::size_t(i)];
        });
        EXPECT_EQ(calls, std::vector<int>(std::size_t(count), 1));
        EXPECT_TRUE((enough && threads > 1) || ranges == (count > 0 ? 1 : 0)) << ranges;
      }
}

// The iterations of a thread that stands still are taken by the others, save the one that it has begun: every other
// thread waits inside its first iteration until all others are done.
TEST(Team, CallerTakesWhatNobodyHasBegun) {
  constexpr Index count = 100;
  Team team(3);
  for (int round = 0; round < 20; ++round) {
    std::atomic<Index> done = 0, waiting = 0;
    team.share(count, [&](Index, int thread) {
      if (thread == 0) {
        ++done;
        return;
      }
      ++waiting;
      while (done + waiting < count) std::this_thread::yield();
    });
    EXPECT_EQ(done + waiting, count);
    EXPECT_LE(waiting, 2);
  }
}

TEST(Team, RethrowsAnException) {
  for (const int threads : thread_counts) {
    Team team(threads);
    for (const Index thrower : {0, 3, 9})
      EXPECT_THROW(team.share(10,
                              [&](Index i, int) {
                                if (i == thrower) throw std::runtime_error("one");
                              }),
                   std::runtime_error);
    std::atomic<Index> sum = 0;
    team.share(10, [&](Index i, int) { sum += i; });
    EXPECT_EQ(sum, 45);
  }
}

TEST(Team, ALoopInALoopIsDone) {
  Team team(4);
  std::vector<std::atomic<int>> calls(12 * 5);
  team.share(12, [&](Index i, int) { team.share(5, [&](Index k, int) { ++calls[std::size_t(5 * i + k)]; }); });
  for (const auto& count : calls) EXPECT_EQ(count, 1);
}

TEST(Team, ServesTwoCallers) {
  Team team(3);
  std::array<Index, 2> sums{};
  const auto many = [&](Index& all) {
    for (int round = 0; round < 200; ++round) {
      std::atomic<Index> sum = 0;
      team.share(50, [&](Index i, int) { sum += i; });
      all += sum;
    }
  };
  std::thread other([&] { many(sums[0]); });
  many(sums[1]);
  other.join();
  EXPECT_EQ(sums[0], 200 * 1225);
  EXPECT_EQ(sums[1], 200 * 1225);
}

// A forked process has none of the threads.
TEST(Team, WorksInAForkedProcess) {
  const auto in_child = [](auto team) {
    std::atomic<Index> sum = 0;
    team->share(100, [&](Index i, int) { sum += i; });
    team.reset();
    std::_Exit(sum == 4950 ? 0 : 1);
  };
  auto team = std::make_unique<Team>(4);
  team->share(8, [](Index, int) {});
  EXPECT_EXIT(in_child(std::move(team)), testing::ExitedWithCode(0), "");
}

}  // namespace
}  // namespace bromwich::cpu

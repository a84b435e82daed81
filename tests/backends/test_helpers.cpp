// Threads that share short work (kernels/helpers.hpp).

#include "kernels/helpers.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <vector>

namespace bromwich {
namespace {

// Each number is processed once, by any thread; no thread is at work afterwards.
TEST(Helpers, ShareWorkOutOnce) {
  for (const int count : {0, 1, 5}) {
    Helpers helpers(count);
    for (int round = 0; round < 200; ++round) {
      std::vector<int> done(50, 0);
      std::atomic<std::size_t> next = 0;
      bool began = false;
      helpers.share(
          [&] {
            for (std::size_t i; (i = next++) < done.size();) ++done[i];
          },
          [&] { began = true; });
      EXPECT_TRUE(began);
      ASSERT_EQ(done, std::vector<int>(50, 1)) << count << " helpers, round " << round;
    }
  }
}

TEST(Helpers, EndWithoutWork) { Helpers unused(3); }

}  // namespace
}  // namespace bromwich

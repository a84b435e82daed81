// Threads that share short work (kernels/helpers.hpp).

#include "core/base/first_touch.hpp"
#include "kernels/helpers.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <thread>
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

// Every page is written, nothing beyond the values, and nothing after the end.
TEST(FirstTouch, WritesAllPages) {
  constexpr std::size_t count = (std::size_t(1) << 19) + 700, page = 512;
  std::vector<double> values(count + 1, 3);
  { const FirstTouch touch(values.data(), count); }
  if (std::thread::hardware_concurrency() > 1) {
    std::size_t since = page;
    for (std::size_t i = 0; i < count; ++i, ++since) {
      if (std::isnan(values[i])) since = 0;
      ASSERT_LT(since, page) << i;
    }
  }
  EXPECT_EQ(values[count], 3);
  values.assign(count, 3);
  EXPECT_EQ(values, std::vector<double>(count, 3));
}

}  // namespace
}  // namespace bromwich

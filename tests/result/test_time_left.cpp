#include "core/result/time_left.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

// 100 steps at 20 a second.
TEST(TimeLeft, OfSteps) {
  TimeLeft left;
  EXPECT_FALSE(left.after({0, 0, 100}, 7));
  EXPECT_NEAR(left.after({20, 0, 100}, 8).value(), 4, 1e-12);
  EXPECT_NEAR(left.after({60, 0, 100}, 10).value(), 2, 1e-12);
  EXPECT_EQ(left.after({100, 0, 100}, 12).value(), 0);
}

TEST(TimeLeft, CountsFromTheFirstReport) {
  TimeLeft left;
  EXPECT_FALSE(left.after({50, 0, 100}, 100));  // set-up took 100 s, which says nothing of the steps
  EXPECT_NEAR(left.after({75, 0, 100}, 101).value(), 1, 1e-12);
}

TEST(TimeLeft, BeginsAnewOnEveryGrid) {
  TimeLeft left;
  left.after({0, 0, 100}, 0);
  left.after({100, 0, 100}, 1);
  EXPECT_FALSE(left.after({10, 0, 200}, 2));
  EXPECT_NEAR(left.after({20, 0, 200}, 3).value(), 18, 1e-12);
  EXPECT_FALSE(left.after({5, 0, 200}, 4));  // the same number of steps from the start
}

// The change is 10^-k after sweep k, at two sweeps a second: 12 - k sweeps are left to 1e-12.
TEST(TimeLeft, OfSweeps) {
  TimeLeft left(1e-12);
  EXPECT_FALSE(left.after({1, 1e-1, 0}, 0.5));
  for (Index k = 2; k <= 12; ++k)
    EXPECT_NEAR(left.after({k, std::pow(10, -double(k)), 0}, double(k) / 2).value(), double(12 - k) / 2, 1e-9) << k;
  EXPECT_EQ(left.after({13, 1e-13, 0}, 6.5).value(), 0);
}

TEST(TimeLeft, SaysNothingOfSweepsThatDoNotConverge) {
  TimeLeft left(1e-12);
  left.after({1, 1, 0}, 0);
  EXPECT_FALSE(left.after({2, 1, 0}, 1));
  EXPECT_FALSE(left.after({3, 2, 0}, 2));
  EXPECT_FALSE(left.after({4, NAN, 0}, 3));
}

}  // namespace
}  // namespace bromwich

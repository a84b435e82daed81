#include "report/scale.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich::report {
namespace {

TEST(Scale, UnitsTakePrefixes) {
  const auto scaled = [](const std::string& unit, double largest) {
    const ScaledUnit found = with_prefix(unit, largest);
    return std::pair(found.name, found.size);
  };
  EXPECT_EQ(scaled("s", 2e-4), std::pair(std::string("µs"), 1e-6));
  EXPECT_EQ(scaled("V", 2.5e4), std::pair(std::string("kV"), 1e3));
  EXPECT_EQ(scaled("s", 3), std::pair(std::string("s"), 1.0));
  EXPECT_EQ(scaled("A", 0), std::pair(std::string("A"), 1.0));
  EXPECT_EQ(scaled("mm", 1e-7), std::pair(std::string("mm"), 1.0)) << "has a prefix";
  EXPECT_EQ(scaled("", 1e-7), std::pair(std::string(), 1.0));
  EXPECT_EQ(scaled("W", 1e30), std::pair(std::string("W"), 1.0));
}

TEST(Scale, PutsTheEndsAtTheEnds) {
  const Scale linear(-2, 6, 100, 20), decades(1e-6, 1e2, 0, 80, true);
  EXPECT_DOUBLE_EQ(linear(-2), 100);
  EXPECT_DOUBLE_EQ(linear(6), 20);
  EXPECT_DOUBLE_EQ(linear(2), 60);
  EXPECT_NEAR(decades(1e-6), 0, 1e-12);
  EXPECT_NEAR(decades(1e-2), 40, 1e-12);
  EXPECT_NEAR(decades(1e2), 80, 1e-12);
}

// Ticks are the multiples of a step of 1, 2 or 5 times a power of ten, all of them, with labels that are not repeated.
TEST(Scale, HasRoundTicks) {
  for (const double hi : {1e-9, 0.005, 0.37, 1., 3 * M_PI, 400., 2.5e8})
    for (const double lo : {0., -hi, 0.3 * hi}) {
      const auto ticks = Scale(lo, hi, 0, 1).ticks(6);
      ASSERT_GE(ticks.size(), 3u) << lo << " " << hi;
      ASSERT_LE(ticks.size(), 9u) << lo << " " << hi;
      const double step = ticks[1].value - ticks[0].value, power = std::pow(10, std::floor(std::log10(step) + 1e-9));
      const double factor = step / power;
      EXPECT_TRUE(std::abs(factor - 1) < 1e-6 || std::abs(factor - 2) < 1e-6 || std::abs(factor - 5) < 1e-6) << factor;
      EXPECT_LT(ticks.front().value, lo + step * (1 + 1e-9));
      EXPECT_GT(ticks.back().value, hi - step * (1 + 1e-9));
      for (std::size_t i = 1; i < ticks.size(); ++i) EXPECT_NE(ticks[i].label, ticks[i - 1].label);
      for (const Tick& tick : ticks) EXPECT_NE(tick.label, "−0");
    }
}

TEST(Scale, LogarithmicTicksArePowersOfTen) {
  const auto ticks = Scale(1e-12, 1, 0, 1, true).ticks(5);
  ASSERT_EQ(ticks.size(), 13u);
  EXPECT_EQ(ticks.front().label, "1e−12");
  EXPECT_EQ(ticks.back().label, "1");
  EXPECT_NEAR(ticks[5].value, 1e-7, 1e-19);
  EXPECT_EQ(Scale(1, 100, 0, 1, true).ticks(5).size(), 7u);  // 1 2 5 10 20 50 100
}

// Of a value that is constant but for rounding.
TEST(Scale, RangesOfRoundingAreThoseOfAValue) {
  EXPECT_FALSE(apart(12, 12 + 2e-15));
  EXPECT_TRUE(apart(0, 1e-300));
  const Range range = range_of({12, 12 + 2e-15, 12 - 2e-15});
  EXPECT_LT(range.lo, 11);
  EXPECT_GT(range.hi, 13);
  EXPECT_LT(Scale(range.lo, range.hi, 0, 1).ticks(5).size(), 9u);
}

TEST(Scale, RangesHaveRoomAndZero) {
  EXPECT_EQ(range_of({1, 10}).lo, 0);
  EXPECT_GT(range_of({1, 10}).hi, 10);
  EXPECT_LT(range_of({9, 10}).lo, 9);
  EXPECT_GT(range_of({9, 10}).lo, 8);
  EXPECT_EQ(range_of({-1e-15, 10}).lo, 0);  // rounding
  EXPECT_LT(range_of({-1, 10}).lo, -1);
  EXPECT_EQ(range_of({NAN, 3, INFINITY}).lo, 2.7);
  EXPECT_LT(range_of({}).lo, range_of({}).hi);
  EXPECT_LT(range_of({0}).lo, range_of({0}).hi);
  EXPECT_EQ(range_of({3e-7, 0, -2, 4e-3}, true).lo, 1e-7);
  EXPECT_EQ(range_of({3e-7, 0, -2, 4e-3}, true).hi, 1e-2);
  EXPECT_DOUBLE_EQ(range_of({600, 4000}, true).lo, 500);
  EXPECT_DOUBLE_EQ(range_of({600, 4000}, true).hi, 5000);
  EXPECT_LT(range_of({1e-3}, true).lo, range_of({1e-3}, true).hi);
}

TEST(Scale, NumbersAreShortAndTextIsSafe) {
  EXPECT_EQ(short_number(0.25), "0.25");
  EXPECT_EQ(short_number(-1e-6), "−1e−6");
  EXPECT_EQ(short_number(1.5e7), "1.5e7");
  EXPECT_EQ(short_number(12345.678, 3), "1.23e4");
  EXPECT_EQ(short_number(0), "0");
  EXPECT_EQ(short_number(NAN), "–");
  EXPECT_EQ(escaped("<a href=\"x\"> & \x01"), "&lt;a href=&quot;x&quot;&gt; &amp;  ");
}

}  // namespace
}  // namespace bromwich::report

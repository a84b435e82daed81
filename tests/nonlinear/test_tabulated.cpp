// Sources from tables of a grid against the functions that they were made from.

#include "nonlinear/tabulated.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

TEST(Tabulated, IsTheFunctionAndReadsTheTableOnTheGrid) {
  constexpr double T = 1.25;
  constexpr Index J = 37;
  Index calls = 0;
  const auto jump = [&](double t, Eigen::Ref<Vector> v) {
    ++calls;
    v << std::sin(3 * t), t < T * 12 / J ? -1 : 2;
  };
  const TimeFunction table = tabulated(jump, T, J, 2);
  EXPECT_EQ(calls, J + 1);
  Vector found(2), expected(2);
  const double h = T / double(J);
  for (Index j = 0; j <= J; ++j) {
    for (const double t : {T * double(j) / double(J), h * double(j), h + h * double(j - 1)}) {
      calls = 0;
      table(t, found);
      EXPECT_EQ(calls, 0) << j;
      jump(T * double(j) / double(J), expected);
      EXPECT_EQ(found, expected) << j;
    }
    for (const double away : {-0.3 * h, -1e-12 * T, 1e-12 * T, 0.5 * h}) {  // the sides of a jump, and between
      const double t = T * double(j) / double(J) + away;
      calls = 0;
      table(t, found);
      EXPECT_EQ(calls, 1) << j << " " << away;
      jump(t, expected);
      EXPECT_EQ(found, expected) << j << " " << away;
    }
  }
}

TEST(Tabulated, EmptyStaysEmpty) { EXPECT_FALSE(tabulated({}, 1, 4, 2)); }

}  // namespace
}  // namespace bromwich

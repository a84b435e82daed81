#include "core/result/estimated_quantity.hpp"

#include <gtest/gtest.h>

namespace bromwich {
namespace {

TEST(EstimatedQuantity, SaysWhatTheEstimateIsOf) {
  Result r;
  EXPECT_EQ(estimated_quantity(r), "") << "no estimate";
  r.error_estimate = 1e-3;
  r.method = Method::multigrid;
  EXPECT_EQ(estimated_quantity(r), "y") << "of grids of multigrid";
  r.method = Method::events;
  r.x = RowMatrix::Zero(2, 1);
  EXPECT_EQ(estimated_quantity(r), "y and x");
  r.continuous = false;
  EXPECT_EQ(estimated_quantity(r), "the mean of y over [0, t] and x");
  r.errors.emplace();
  r.errors->discretisation = 1e-3;
  EXPECT_EQ(estimated_quantity(r), "y") << "located events control y although it jumps";
  r.errors->of_integral = true;
  EXPECT_EQ(estimated_quantity(r), "the mean of y over [0, t]");
  r.errors->states = 1e-4;
  EXPECT_EQ(estimated_quantity(r), "the mean of y over [0, t] and x");
  r.errors->discretisation = 0.1;  // above the estimate: with --tol-x y is not controlled
  EXPECT_EQ(estimated_quantity(r), "x");
}

}  // namespace
}  // namespace bromwich

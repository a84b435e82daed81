#pragma once
// Cases of Solver, and the comparison of its results with those of solve().

#include "catalogue/catalogue.hpp"
#include "core/solve/solve.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

namespace bromwich::solver_test {

// Natural units of the first scene against those of the changed one: differences by
// rounding, amplified by M^{-1} at most.
constexpr double rounding = 1e-11;

inline void expect_same(const Result& found, const Result& expected, const std::string& what) {
  ASSERT_EQ(found.status, expected.status) << what << ": " << found.reason << " / " << expected.reason;
  EXPECT_EQ(found.method, expected.method) << what;
  ASSERT_EQ(found.y.rows(), expected.y.rows()) << what;
  const auto close = [&](const RowMatrix& a, const RowMatrix& b, const char* name) {
    ASSERT_EQ(a.rows(), b.rows()) << what << " " << name;
    ASSERT_EQ(a.cols(), b.cols()) << what << " " << name;
    double most = rounding;
    for (const double v : b.reshaped()) most = std::isnan(v) ? most : std::max(most, rounding * std::abs(v));
    for (Index j = 0; j < a.rows(); ++j) {
      const auto difference = (a.row(j) - b.row(j)).array().abs();
      const auto both_open = a.row(j).array().isNaN() && b.row(j).array().isNaN();
      ASSERT_TRUE((difference <= most || both_open).all()) << what << " " << name << " row " << j;
    }
  };
  close(found.y, expected.y, "y");
  close(found.x, expected.x, "x");
}

struct SolverCase {
  std::string name;
  Scene scene;
  Method method = Method::automatic;
  Index steps = 64;
  double tolerance = 0;
};

inline Scene sparse_signorini() {
  Scene scene = make_scene("signorini", {{"Q", 24}});
  scene.dynamics = to_sparse(get<KroneckerDynamics>(scene.dynamics));
  return scene;
}

inline TimeFunction times(double factor, const TimeFunction& function) {
  if (!function) return {};
  return [factor, function](double t, Eigen::Ref<Vector> value) {
    function(0.7 * t, value);
    value *= factor;
  };
}

}  // namespace bromwich::solver_test

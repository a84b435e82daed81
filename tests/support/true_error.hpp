#pragma once
// Errors of y as error control measures them.

#include "core/solve/solve.hpp"
#include "tests/support/run.hpp"

#include <cmath>
#include <limits>

namespace bromwich::tolerance_test {

inline Options options_to(double tolerance, Method method = Method::automatic) {
  Options options = options_for(method);
  options.tolerance = tolerance;
  return options;
}

/// Largest difference over t > 0, each component relative to max(max |known|, 1e-3 of the largest component). `known`
/// has `stride` times as many steps.
inline double relative(const RowMatrix& found, const RowMatrix& known, Index stride) {
  Vector error = Vector::Zero(found.cols()), size = error;
  for (Index j = 1; j < found.rows(); ++j) {
    const auto apart = (found.row(j) - known.row(stride * j)).cwiseAbs();
    if (!apart.allFinite()) return std::numeric_limits<double>::infinity();
    error = error.cwiseMax(apart.transpose());
    size = size.cwiseMax(known.row(stride * j).cwiseAbs().transpose());
  }
  size = size.cwiseMax(1e-3 * size.maxCoeff());
  return (error.array() > 0).select(error.cwiseQuotient(size), 0).maxCoeff();
}

inline RowMatrix exact_y(const Scene& scene, const Result& result) {
  RowMatrix known(result.steps + 1, scene.constraints());
  Vector x(scene.states()), y(scene.constraints());
  for (Index j = 0; j <= result.steps; ++j) {
    scene.exact(result.t[j], x, y);
    known.row(j) = y.transpose();
  }
  return known;
}

/// Error of y against the exact solution, or against eight times the steps, whose own error is at most 1/8 (first
/// order).
inline double true_error(const Scene& scene, const Result& result) {
  const Index J = result.steps;
  if (!scene.exact) {
    const Index stride = 8;
    return relative(result.y, solved_y(scene, result.method, stride * J), stride);
  }
  return relative(result.y, exact_y(scene, result), 1);
}

// For y smooth between few kinks, orders follow theory and the estimate is close to the error. Moving ends of a contact
// set change the error of a grid, and differences of grids, by factors of up to sqrt(2) from their trend. With an
// observed order of 1.5 instead of 2, the estimate is at most 2 (2^2 - 1)/(2^1.5 - 1) = 3.3 times the error, or half of
// it; 4 with the error of the reference.
constexpr double least_effectivity = 0.5, largest_effectivity = 4;

}  // namespace bromwich::tolerance_test

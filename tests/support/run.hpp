#pragma once
// Shared by the tests of the solver.

#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <ostream>

namespace bromwich {

/// Lets GoogleTest name a status.
inline void PrintTo(Status status, std::ostream* out) { *out << to_string(status); }

/// Bound for two solutions of the same discrete problem on scenes of size 1. They differ by rounding and by kernel
/// errors: weights to about 1e-13 of their largest (below 0.1), summed over about 64 lags and amplified by L = max
/// ||M_SS^{-1}|| <= 3 and at most e^{L ||K||} < e^6.
inline constexpr double same_problem = 1e-11;

/// Largest difference; NaN if either has one, infinite if the shapes differ.
inline double distance(const RowMatrix& a, const RowMatrix& b) {
  if (a.rows() != b.rows() || a.cols() != b.cols()) return std::numeric_limits<double>::infinity();
  return (a - b).cwiseAbs().maxCoeff<Eigen::PropagateNaN>();
}

inline Options options_for(Method method, Index steps = 0) {
  Options options;
  options.method = method;
  options.steps = steps;
  return options;
}

/// Method march, with the trace and all states.
inline Options marched(Index steps) {
  Options options = options_for(Method::march, steps);
  options.trace = true;
  options.states = StateSelection::all;
  return options;
}

/// One CPU thread. On one grid, where neither steps nor a tolerance is given.
inline Result run(const Scene& scene, Options options) {
  const auto backend = make_cpu_backend(1);
  if (!controls_error(options) && controls_error(with_defaults(options, scene))) options.steps = scene.steps();
  return solve(scene, *backend, options);
}

inline Result run(const Scene& scene, Method method, Index steps = 0) { return run(scene, options_for(method, steps)); }

/// y of a run that must end solved; all NaN if it did not.
inline RowMatrix solved_y(const Scene& scene, Method method, Index steps) {
  const Result result = run(scene, method, steps);
  EXPECT_EQ(result.status, Status::solved) << scene.name << ", " << to_string(method) << ": " << result.reason;
  if (result.y.rows() == steps + 1 && result.y.cols() == scene.constraints()) return result.y;
  ADD_FAILURE() << scene.name << ", " << to_string(method) << ": y is " << result.y.rows() << " x " << result.y.cols();
  return RowMatrix::Constant(steps + 1, scene.constraints(), std::numeric_limits<double>::quiet_NaN());
}

}  // namespace bromwich

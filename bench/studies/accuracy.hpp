#pragma once
// What results are measured against: the exact solution of a scene, or march on a grid so fine that its own error,
// which is reported, does not count.

#include "core/solve/solve.hpp"

#include <string>

namespace bromwich::app {

/// Largest entry and root mean square of a difference over the rows t_j >= T/16, where the initial layer has passed;
/// NaN where either side holds a NaN.
struct Deviation {
  double max = 0, rms = 0;
};
Deviation deviation(const RowMatrix& values, const RowMatrix& reference);

/// Of y, and of the trace N x where the result has one (NaN otherwise).
struct Errors {
  Deviation y, trace;
};
inline constexpr const char* error_definition =
    "largest entry (max) and root mean square (rms) over all constraints and the time points t >= T/16 of the grid";

class Truth {
 public:
  /// The exact solution where the scene has one, else march with `steps` steps. Throws Error where that is not solved.
  Truth(const Scene&, Backend&, Index steps);

  /// At the time points that both have: the steps of `result` must divide those of the reference or be a multiple of
  /// them; any number against an exact solution.
  Errors of(const Result& result) const;

  const std::string& source() const { return source_; }
  /// How far the reference is from itself with half the steps; 0 for an exact solution.
  const Errors& known_to() const { return known_to_; }
  /// Steps of the reference; 0 for an exact solution.
  Index steps() const { return y_.rows() > 0 ? y_.rows() - 1 : 0; }

 private:
  const Scene& scene_;
  RowMatrix y_, trace_;
  std::string source_;
  Errors known_to_;
};

/// Every `stride`-th row: the common times of a finer grid.
RowMatrix common_rows(const RowMatrix& values, Index stride);

}  // namespace bromwich::app

#pragma once
// References for errors: the exact solution of a scene, or march on a grid so fine that its own error, which is
// reported, is negligible.

#include "core/solve/solve.hpp"

#include <string>

namespace bromwich::app {

/// Largest entry and root mean square of a difference over the rows t_j >= T/16, after the initial layer; NaN if either
/// side has a NaN.
struct Deviation {
  double max = 0, rms = 0;
};
Deviation deviation(const RowMatrix& values, const RowMatrix& reference);

/// Errors of y, and of the trace N x if the result has one (NaN otherwise).
struct Errors {
  Deviation y, trace;
};
inline constexpr const char* error_definition =
    "largest entry (max) and root mean square (rms) over all constraints and the time points t >= T/16 of the grid";

class Truth {
 public:
  /// The exact solution if the scene has one, otherwise march with `steps` steps. Throws Error if that is not solved.
  Truth(const Scene&, Backend&, Index steps);

  /// Errors at the common time points: the steps of `result` must divide those of the reference or be a multiple of
  /// them; with an exact solution any number is allowed.
  Errors of(const Result& result) const;

  const std::string& source() const { return source_; }
  /// Difference of the reference from the same with half the steps; 0 for an exact solution.
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

#pragma once
// References for results of error control: the exact solution, or a solve on a grid 12 times as fine as the finest grid
// of error control and not one of its refinements by two.

#include "bench/studies/study.hpp"

namespace bromwich::app {

/// Largest errors over the time points t > 0 in the units of core/solve/error_control.hpp: of y relative to
/// max(1, max |y|), of its running mean likewise, of x the largest component, relative to max(1, its largest value).
struct TolErrors {
  double y, mean, x;
};

class TolTruth {
 public:
  /// For results with `finest` steps or a divisor of it. Throws Error if the scene has no exact solution and the
  /// reference is not solved within `seconds` (0: it is not tried).
  TolTruth(const SceneChoice&, Backend&, const Options&, Index finest, double seconds_for_finest, double seconds);

  /// NaN for a result with more steps.
  TolErrors of(const Result& result) const;

  const std::string& source() const { return source_; }
  /// Difference of the reference from one with half the steps; 0 for an exact solution.
  const TolErrors& known_to() const { return known_to_; }
  /// Difference from the values of the scene file at one time, relative in the same way; NaN if there are none.
  double from_file() const { return from_file_; }

 private:
  void sample_exact(const Scene&, Index steps);

  RowMatrix y_, mean_, x_;
  std::string source_;
  Index finest_;
  TolErrors known_to_{0, 0, 0};
  double from_file_;
};

}  // namespace bromwich::app

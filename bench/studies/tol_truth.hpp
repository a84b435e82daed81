#pragma once
// What results of error control are measured against: the exact solution, or a solve on a grid that none of the grids
// of error control has for a coarser one, 12 times as fine as the finest of them.

#include "bench/studies/study.hpp"

namespace bromwich::app {

/// Largest errors over the time points t > 0 in the units of core/solve/error_control.hpp: of y relative to
/// max(1, max |y|), of its running mean likewise, of x the largest component, relative to max(1, its largest value).
struct TolErrors {
  double y, mean, x;
};

class TolTruth {
 public:
  /// For results with `finest` steps or a number that divides it. Throws Error where the reference is not solved within
  /// `seconds` (0: none is tried) and the scene has no exact solution.
  TolTruth(const SceneChoice&, Backend&, const Options&, Index finest, double seconds_for_finest, double seconds);

  /// NaN for a result with more steps.
  TolErrors of(const Result& result) const;

  const std::string& source() const { return source_; }
  /// How far the reference is from one with half the steps; 0 for an exact solution.
  const TolErrors& known_to() const { return known_to_; }
  /// How far it is from the values that the scene file gives at one time, relative likewise; NaN where there are none.
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

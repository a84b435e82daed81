#pragma once
// The stopping rule of the cycles of a multigrid method.

#include "../iteration/functional_iteration.hpp"

#include <cmath>
#include <optional>

namespace bromwich {

/// Monitors the changes of y from cycle to cycle.
class CycleWatch {
 public:
  /// `contraction`: assumed for the first cycle, or infinite.
  CycleWatch(double tolerance, double contraction) : tolerance_(tolerance), contraction_(contraction) {}

  /// Takes the change of y by a cycle; returns the outcome if this cycle is the last one.
  std::optional<IterationOutcome> after(double change);

  /// Contraction observed in the last cycle; 0 if none.
  double contraction() const { return seen_ ? contraction_ : 0; }

  /// With contraction c the remaining error after a change is at most change c / (1 - c). c is the larger of the last
  /// two contractions, since the first one is too small because of the error of the start. Infinite if cycles do not
  /// contract, or with too few observations.
  double left() const;

  /// The cycles change from now on: earlier observations are discarded.
  void restart();

  static constexpr Index most_cycles = 40;

 private:
  double tolerance_, contraction_, change_ = 0, worst_ = INFINITY;
  Index slow_ = 0, cycles_ = 0;
  bool seen_ = false;
};

}  // namespace bromwich

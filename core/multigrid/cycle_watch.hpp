#pragma once
// When the cycles of a multigrid method are over.

#include "../iteration/functional_iteration.hpp"

#include <cmath>
#include <optional>

namespace bromwich {

/// Watches the changes of y from cycle to cycle.
class CycleWatch {
 public:
  /// `contraction`: of the first cycle, or infinite.
  CycleWatch(double tolerance, double contraction) : tolerance_(tolerance), contraction_(contraction) {}

  /// The outcome, where the cycle that changed y so much was the last one.
  std::optional<IterationOutcome> after(double change);

  /// As it was seen in the last cycle; 0 where it was not.
  double contraction() const { return seen_ ? contraction_ : 0; }

  /// With contraction c what is left after a change is at most change c / (1 - c); c is the larger of the last two,
  /// since the first is flattered by the error of the start. Infinite where cycles do not contract, or too few were
  /// seen.
  double left() const;

  /// Cycles are others from now on: what was seen says nothing of them.
  void restart();

  static constexpr Index most_cycles = 40;

 private:
  double tolerance_, contraction_, change_ = 0, worst_ = INFINITY;
  Index slow_ = 0, cycles_ = 0;
  bool seen_ = false;
};

}  // namespace bromwich

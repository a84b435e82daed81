#pragma once
// Forecast of the remaining sweeps of the functional iteration from the observed ones. The iteration is causal. Rows of
// y settle from t = 0 on, at a speed that a Volterra kernel keeps (changes may grow before), or all together if every
// sweep contracts. The smaller of two numbers is used, both from the second half of the observed sweeps:
//
//     (J - front) / (rows settled per sweep),   ln(tolerance / change) / ln(contraction).
//
// Once all earlier rows have settled, the row at the front depends only on itself: if its changes do not decrease, they
// never will.

#include "../base/types.hpp"

#include <optional>
#include <string>
#include <vector>

namespace bromwich {

class SweepForecast {
 public:
  SweepForecast(Index steps, double tolerance, Index most_sweeps)
      : steps_(steps), tolerance_(tolerance), most_sweeps_(most_sweeps) {}

  void add(Index settled_rows, double change);

  /// Remaining sweeps; infinite if neither the front moves nor the changes decrease. Empty with too few observations.
  std::optional<double> sweeps_left() const;

  /// The reason to stop, if several times the limit of sweeps would be needed; otherwise empty.
  std::optional<std::string> hopeless() const;

  static constexpr Index fewest_seen = 64;

 private:
  double rows_a_sweep() const;
  double contraction() const;

  Index steps_;
  double tolerance_;
  Index most_sweeps_;
  std::vector<double> front_, change_;
};

/// The row at the front of an iteration in which no further rows settle.
class FrontRow {
 public:
  /// Adds y of the row `at` after a sweep. Returns whether its changes decrease, once it is known.
  std::optional<bool> contracts(Index at, const Vector& y);
  /// Factor by which a change of the row grows per sweep.
  double factor() const;

  static constexpr int seen = 24;

 private:
  Index at_ = -1;
  Vector last_;
  std::vector<double> changes_;
};

}  // namespace bromwich

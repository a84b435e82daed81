#pragma once
// What the sweeps of the functional iteration show of those that are still to come. The iteration is causal: rows of y
// settle from t = 0 on, at a speed that a Volterra kernel keeps (changes may grow before), or all together where every
// sweep contracts. So many sweeps more are needed as the faster of the two says, by the second half of those seen:
//
//     (J - front) / (rows settled a sweep),   ln(tolerance / change) / ln(contraction).
//
// The row at the front depends on itself alone, once what lies before it has settled: where its changes do not fall,
// they never will.

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

  /// Sweeps still needed; infinite where neither the front nor the changes move. Nothing with too few seen.
  std::optional<double> sweeps_left() const;

  /// Why it is not worth going on, or nothing: more sweeps than several times the limit.
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

/// The row at the front of an iteration that stands still.
class FrontRow {
 public:
  /// y of the row `at` after a sweep. The answer, once it is known: changes fall (true), or they do not.
  std::optional<bool> contracts(Index at, const Vector& y);
  /// A change of the row comes back so many times as large.
  double factor() const;

  static constexpr int seen = 24;

 private:
  Index at_ = -1;
  Vector last_;
  std::vector<double> changes_;
};

}  // namespace bromwich

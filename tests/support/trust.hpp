#pragma once
// Judges a result by the true solution: distance of y (or of its mean over [0, t], if the result reports that) and of x
// from the event-located oracle, each component relative to max(max_t |c_i|, 1e-3 of the largest of its kind, in the
// natural units of the solver).

#include "core/solve/solve.hpp"
#include "tests/support/oracle_events.hpp"
#include "tests/support/random_sources.hpp"

#include <string>

namespace bromwich::oracle {

struct TrueError {
  double x = 0, y = 0;  ///< y: of the mean where `of_mean`
  bool of_mean = false;
  double x_at = 0, y_at = 0;  ///< times of the largest errors, in the units of the scene
  double largest() const { return x > y ? x : y; }
};

/// For a result with all states.
TrueError true_error(const SourceScene&, const EventSolution&, const Result&);

}  // namespace bromwich::oracle

#pragma once
// Judges a result by the true solution: how far y (or its mean over [0, t], where the result says that it is that) and
// x are from the event-located oracle, each component relative to max(max_t |c_i|, 1e-3 of the largest of its kind).

#include "core/solve/solve.hpp"
#include "tests/support/oracle_events.hpp"
#include "tests/support/random_sources.hpp"

#include <string>

namespace bromwich::oracle {

struct TrueError {
  double x = 0, y = 0;  ///< y: of the mean where `of_mean`
  bool of_mean = false;
  double x_at = 0, y_at = 0;  ///< where they are largest, in the units of the scene
  double largest() const { return x > y ? x : y; }
};

/// Of a result with all states.
TrueError true_error(const SourceScene&, const EventSolution&, const Result&);

}  // namespace bromwich::oracle

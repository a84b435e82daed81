#pragma once
// What core/certificate finds out about y of a result, in numbers without units.

#include "../base/types.hpp"

namespace bromwich {

struct Certificate {
  /// Backward error d(t) = |min(w, D y)| / s of y with the state of the exact flow: the result is exact for a scene
  /// whose g is off by d s, s_i = max_t (|M||y| + |N||x| + |g|)_i.
  double mean_defect = 0, largest_defect = 0;
  double defect_at = 0;   ///< the time of the largest over T
  Index defect_row = -1;  ///< its row of w
  /// Differences from the located solution (core/events), the largest over the rows, relative to the size of the
  /// component (core/accuracy/convergence.hpp). `error_of_mean` is that of the mean of y over [0, t]. Where y may be
  /// one of several, `error_of_y` is no more than that of B y and M y.
  double error_of_x = 0, error_of_y = 0, error_of_mean = 0;
  double typical_error_of_x = 0;  ///< the same beside values so far, exceeded at one row of twenty
  bool impulses = false;          ///< the state jumps: y is known by its mean
};

}  // namespace bromwich

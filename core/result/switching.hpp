#pragma once
// When constraints become active and inactive, more exactly than the time grid.
//
// Component i is active at t_j where y_j > 0. Where that changes in the step from t_j to t_{j+1}, y of the active side
// is continued into the step to where it vanishes, linearly from the two rows nearest to it:
//
//     off:  t* = t_j + h y_j / (y_{j-1} - y_j),          on:  t* = t_{j+1} - h y_{j+1} / (y_{j+2} - y_{j+1}).
//
// Where y is discontinuous (Result::y_left) the two values are those of the interval next to the switch that is active
// throughout. The second difference of three rows says how far that is off: O(h^2) where y leaves 0 with a slope. Where
// y jumps, or is active for one row only, or the root does not lie in the step, the middle of the step is all that is
// known.

#include "result.hpp"

namespace bromwich {

struct Switch {
  double t = 0;
  Index component = 0;
  bool on = false;   ///< y becomes positive
  double error = 0;  ///< estimated, of t: h/2 where only the step is known
};

/// Of all components of a result, in order of time; rows that are not valid end it. `negligible`: y below this part of
/// its largest value counts as 0.
std::vector<Switch> switches(const Result&, double negligible = 1e-12);

}  // namespace bromwich

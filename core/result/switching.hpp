#pragma once
// The times at which constraints become active and inactive, more accurately than the time grid.
//
// Component i is active at t_j if y_j > 0. If this changes in the step from t_j to t_{j+1}, y of the active side is
// extrapolated linearly to zero, from the two nearest rows:
//
//     off:  t* = t_j + h y_j / (y_{j-1} - y_j),          on:  t* = t_{j+1} - h y_{j+1} / (y_{j+2} - y_{j+1}).
//
// For discontinuous y (Result::y_left) the two values are those of the adjacent interval that is active throughout. The
// second difference of three rows estimates the error: O(h^2) if y leaves 0 with a slope. If y jumps, or is active for
// one row only, or the root is not in the step, t* is the middle of the step.

#include "result.hpp"

namespace bromwich {

struct Switch {
  double t = 0;
  Index component = 0;  ///< of y
  bool on = false;      ///< y becomes positive
  double error = 0;     ///< estimated, of t: h/2 if only the step is known
};

/// The switches of all components of a result, in order of time, up to the first invalid row. `negligible`: y below
/// this part of its largest value counts as 0.
std::vector<Switch> switches(const Result&, double negligible = 1e-12);

/// What a relay does at a switch: lambda is -1, 1, or 0 for a value between them (sliding).
struct RelaySwitch {
  double t = 0;
  Index relay = 0;
  int from = 0, to = 0;
  double error = 0;  ///< estimated, of t
};

/// The switches of a result with y = (s, y+) of 2k components (core/scene/relay.hpp) as those of its k relays: lambda
/// is -1 where y+ > 0, otherwise 0 where s > 0, otherwise 1. Switches of s and y+ within one step (not of
/// method events), or within their errors, are one.
std::vector<RelaySwitch> relay_switches(const Result&, const std::vector<Switch>&, Index relays);

}  // namespace bromwich

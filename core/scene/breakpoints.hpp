#pragma once
// Search for the times at which f and g jump or have a kink, for sources without stated breakpoints.
//
// Values at 65536 times (fewer where one has many components), component by component. Between two of them a source
// that is smooth changes about as much as beside them; where one changes much more, the place is narrowed down by
// halving, to the rounding of t. What still changes by half of that there is a jump. Where the slope changes much more
// than beside, the lines on both sides meet in a kink (small dense scenes only); beside jumps the times are closer.
// Pulses that lie between two of the times are not seen.

#include "scene.hpp"

#include <vector>

namespace bromwich {

/// Increasing; those of Scene::breakpoints among them.
std::vector<double> find_breakpoints(const Scene&);

/// The scene with all of them.
Scene with_all_breakpoints(Scene);

}  // namespace bromwich

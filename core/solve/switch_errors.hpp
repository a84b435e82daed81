#pragma once
// Errors of the times of switches. If y itself has an error, or jumps, interpolation between rows is the smaller part
// of such an error. The same method on J/2 and on 3J/4 steps shows the other part: switches that agree by chance on one
// of the two grids do not agree on the other.

#include "../result/switching.hpp"
#include "solve.hpp"

namespace bromwich {

/// switches(result). The error of each is that of interpolation plus the difference from the coarser grids, or h if
/// they do not have the switch; at least h/2 if y may jump from step to step. Takes about 1.25 times the work of the
/// result. Located switches have the difference of two integrations already.
std::vector<Switch> switches_with_errors(const Scene&, Backend&, const Options&, const Result&);

}  // namespace bromwich

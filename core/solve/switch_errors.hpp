#pragma once
// How well the times of switches are known: interpolation between rows is the smaller part of their error where y
// itself is off, or where it jumps. The same method on J/2 and on 3J/4 steps shows the rest: errors of the grid move
// with it, and what agrees on one of the two by chance does not on the other.

#include "../result/switching.hpp"
#include "solve.hpp"

namespace bromwich {

/// switches(result), each with the error of interpolation plus what the coarser grids differ by, or h where they do not
/// have it; where y may jump from step to step at least h/2. Takes about 1.25 times the work of the result.
std::vector<Switch> switches_with_errors(const Scene&, Backend&, const Options&, const Result&);

/// Of each switch the distance to the nearest one of its component and direction in `other`; `none` where there is
/// none.
std::vector<double> distances(const std::vector<Switch>& found, const std::vector<Switch>& other, double none);

}  // namespace bromwich

#pragma once
// A second opinion on a result of method galerkin: method march, which takes steps with breakpoints in parts, on the
// same grid. With boundary values march starts anew from the states of the result, at x(0) and at a few more points, so
// that a growing mode of the scene has little time to grow; on each block of steps both solve one initial-value
// problem, and a contact that intervals miss shows.

#include "one_grid.hpp"

namespace bromwich {

/// Rows of y, of its integral and of the states that the options ask for, on the grid of `result`. `x`: all states of
/// the result, (J+1) x m, used where the scene has boundary values. If a block is not solved: its status and reason.
Result beside_march(const Scene&, Backend&, const InnerOptions&, const Result& result, const RowMatrix& x);

}  // namespace bromwich

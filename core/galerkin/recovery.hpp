#pragma once
// A Galerkin result at any time, with the order of the method. y is linear on each interval; one exact step with this y
// carries x from the left end of the interval to t.

#include "../result/result.hpp"
#include "discretisation.hpp"

namespace bromwich {

/// The parts of a grid whose steps are of one length.
std::vector<GridPart> grid_parts(const Vector& t);

/// k with t_k <= time < t_{k+1}; the first or the last interval for other times.
Index interval_at(const Vector& t, double time);
/// The node at `time`, to 1e-9 of its interval, or -1.
Index node_at(const Vector& t, double time);

/// The coefficients of a result of method galerkin: N x 2n.
RowMatrix galerkin_coefficients(const Result&);

/// y (left limit), its integral from the node before, and x at `times`, one row each: times.size() x n, x n and x m.
/// Inside an interval of implicit Euler x is linear. NaN after the end of the result. Preconditions: times in [0, T], a
/// result with y_left.
struct GalerkinOutput {
  RowMatrix y, integral, x;
};
GalerkinOutput galerkin_at(const Scene&, const Result&, const std::vector<double>& times);

}  // namespace bromwich

#pragma once
// A Galerkin result at any time, with the order of the method: y is linear on each interval, and x is carried on from
// the state at its left end by one exact step with the part of y that lies before t.

#include "../result/result.hpp"
#include "discretisation.hpp"

namespace bromwich {

/// The parts of a grid whose steps are of one length.
std::vector<GridPart> grid_parts(const Vector& t);

/// The coefficients of a result of method galerkin: N x 2n.
RowMatrix galerkin_coefficients(const Result&);

/// y (left limit) and x at `times`, inside an interval taken by implicit Euler on the line between its ends, one row
/// each: times.size() x n and x m. Precondition: times in [0, T], a result with y_left. NaN where the result does not
/// reach.
struct GalerkinOutput {
  RowMatrix y, x;
};
GalerkinOutput galerkin_at(const Scene&, const Result&, const std::vector<double>& times);

}  // namespace bromwich

#pragma once
// Method galerkin: discretisation (core/galerkin/discretisation.hpp), free unknowns (core/galerkin/free.hpp), solvers
// (core/galerkin/solvers.hpp), and the result.

#include "../result/inner_options.hpp"
#include "../result/result.hpp"
#include "../seam/backend.hpp"

namespace bromwich {

/// On one grid. Initial and boundary values, free rows. y: row 0 is the left end of the first interval, row k the right
/// end of interval k; y_left holds all left ends. Throws Error if the boundary condition and the linear dynamics do not
/// determine the states (E0 + ET e^{TA} singular, dependent rows of [E0 ET]).
Result solve_by_galerkin(const Scene&, Backend&, const InnerOptions&);

}  // namespace bromwich

#pragma once
// The error by rounding of a nearly singular mass matrix. E x' = A x + B y + f is solved as x' = E^{-1} (A x + B y +
// f), and E^{-1} A is known to about eps/rcond(E) only, however it is computed: the entries of E, A and B are rounded
// themselves, as are values of f. The scene is therefore solved again with entries of E that are changed by a few
// roundings, and the difference of the two results is an error of both.

#include "engines.hpp"

namespace bromwich {

/// Below this reciprocal condition, of E with balanced rows and columns, rounding is estimated.
inline constexpr double nearly_singular_mass = 1e-8;

/// Adds that error to the estimate of `result`, solved with these options, where E is dense and nearly singular. With a
/// tolerance that it exceeds, the result is `tolerance_not_met`; on a given grid, a warning names it.
void add_rounding_of_mass(const Scene&, Backend&, const InnerOptions&, Result&);

}  // namespace bromwich

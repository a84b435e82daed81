#pragma once
// A result between its time points, with the order of the method: y is linear there, and x is carried from the time
// point before, s later,
//
//     x(t_j + s) = e^{sA} x_j + ∫_0^s e^{(s-r)A} (B y(t_j + r) + f(t_j + r)) dr,
//
// by one step of the discretisation itself.

#include "solve.hpp"

namespace bromwich {

/// The result with rows at `times` in place of its time points: t, y and the components of x it has recorded. Rows that
/// the result does not reach are NaN. Throws Error for times outside [0, T]; for times between time points where y is
/// not linear there (Result::continuous, euler); for x of sparse dynamics.
Result at_times(const Scene&, Backend&, const Result&, const std::vector<double>& times);

}  // namespace bromwich

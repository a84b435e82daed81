#pragma once
// A result between its time points, with the order of the method: y is linear there, and x is carried from the time
// point before, s later,
//
//     x(t_j + s) = e^{sA} x_j + ∫_0^s e^{(s-r)A} (B y(t_j + r) + f(t_j + r)) dr,
//
// by one step of the discretisation itself. Where y may jump from step to step (M singular, implicit Euler), and for
// sparse dynamics, the problem of a step of length s from x_j is solved.

#include "solve.hpp"

namespace bromwich {

/// The result with rows at `times` in place of its time points: t, y, the components of x it has recorded, and N x if
/// it has that. Rows that the result does not reach are NaN; so is N x between time points where no x is recorded or
/// the scene has free rows. A result whose y may jump is solved again if it does not have all states. Throws Error for
/// times outside [0, T], and for method goal.
Result at_times(const Scene&, Backend&, const Result&, const std::vector<double>& times);

}  // namespace bromwich

#pragma once
// A result between its time points, with the order of the method: y is linear there, and x is carried from the time
// point before, s later,
//
//     x(t_j + s) = e^{sA} x_j + ∫_0^s e^{(s-r)A} (B y(t_j + r) + f(t_j + r)) dr,
//
// by one step of the discretisation itself. Where y is no line (a constraint switches in the step, or a source jumps or
// has a kink), the problem of a step of length s from x_j is solved. So it is if y may jump from step to step (M
// singular, implicit Euler), and for x of sparse dynamics. Results of methods events and shooting have the values of
// one more integration with located switches.

#include "solve.hpp"

namespace bromwich {

/// The result with rows at `times` instead of its time points: t, y, the recorded components of x, and N x if it is
/// recorded. Rows after the end of the result are NaN; so is N x between time points if no x is recorded or the scene
/// has free rows. A result whose y may jump is solved again unless all its states are recorded. Throws Error for times
/// outside [0, T], and for method goal; Interrupted where check_interruption does.
Result at_times(const Scene&, Backend&, const Result&, const std::vector<double>& times);

}  // namespace bromwich

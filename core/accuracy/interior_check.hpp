#pragma once
// Whether a solution that is piecewise linear in y holds between its time points. Grids of J, 2J, 4J, ... steps share
// their points and can all miss the same contact. At one irregular point of every step the state is carried from the
// left end with the y of the result,
//
//     x(t_j + θh) = e^{θhA} x_j + ∫ e^{(θh-s)A} (B y + f)(t_j + s) ds,    w = N x + M y + g,    δ_i = min(y_i,
//     w_i/M_ii),
//
// and δ, what y would have to change there, is averaged over time. Where w falls towards 0 from both sides of a step,
// the lowest value of g in it counts too.

#include "convergence.hpp"

namespace bromwich {

/// max_i (h/T) Σ_j |δ_i(t_j + θ_j h)| / s_i with s_i the size of the mean of y_i. `x`: all states at the time points,
/// (J+1) x m. Steps that hold a breakpoint of the sources or were
/// taken in parts are left out. For dense dynamics and continuous y; M_ii <= 0
/// leaves row i out.
double interior_defect(const Scene&, const Result&, const RowMatrix& x, const ComponentSizes&);

/// What linear functions between the times t miss of a source that jumps between them: max_i ∫ |g_i - line| / ∫ |g_i|,
/// the first over the steps that hold breakpoints, in the form of SampledSource::values.
double missed_between_points(const TimeFunction&, Index width, const std::vector<double>& breakpoints, const Vector& t);

}  // namespace bromwich

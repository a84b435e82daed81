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

/// Errors of y that two grids do not show by their difference in y: where y_i = 0 on both, w_i may be off by more than
/// its value. With e_i the error of N x there, y_i may be min(e_i - w_i, e_i) / M_ii. One time point, n values each;
/// `diagonal`: M_ii; M_ii <= 0 leaves row i out.
Vector hidden_error(const Vector& diagonal, const Vector& y_coarse, const Vector& y_fine, const Vector& e,
                    const Vector& w);

/// Likewise on two grids of J and 2J steps, whose results hold N x (Options::trace). `largest` is that over the time
/// points of the coarse grid, relative to the size of y_i; the mean over time is relative to the mean of y_i. e_i is
/// `share` of what N x of the grids differ by. Free rows are left out; 0 where N x is not known.
struct HiddenError {
  double largest = 0, mean = 0;
};
HiddenError hidden_error(const Scene&, const Result& coarse, const Result& fine, double share, const ComponentSizes&);

/// The error of linear interpolation between the times t for a source that jumps between them: max_i ∫ |g_i - line| / ∫
/// |g_i|, the first over the steps that hold breakpoints, in the form of SampledSource::values.
double missed_between_points(const TimeFunction&, Index width, const std::vector<double>& breakpoints, const Vector& t);

}  // namespace bromwich

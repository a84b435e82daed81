#pragma once
// (2.17) of the Laplace-inversion paper exactly as printed: one contour per time point, scaled by 1/t_j,
//
//     x_j = e^{A t_j} x0 + dv/(2 pi i) Σ_p z'_p (z_p I - A)^{-1} ∫_0^{t_j} e^{z_p (t_j - s)} (B y(s) + f(s)) ds,
//
// with y and f piecewise linear on the grid. Where the printed contour cannot enclose the spectrum of dense dynamics,
// Remarks 2.1 and 2.4 take its place, and where it is real e^{A t_j} x0 has the contour of Remark 2.3
// (numerics/literal_contour.hpp). Time points share nothing: J (P+1) shifted solves (stored here; the paper repeats
// them in every iteration) and O(J^2 P n) operations per iteration. A reference, not a fast method.

#include "functional_iteration.hpp"

namespace bromwich {

void solve_literally(const DiscreteProblem&, const Options&, Result& result);

}  // namespace bromwich

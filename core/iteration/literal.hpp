#pragma once
// (2.17) of the Laplace-inversion paper to the letter: a contour per time point, scaled by 1/t_j,
//
//     x_j = e^{A t_j} x0 + dv/(2 pi i) Σ_p z'_p (z_p I - A)^{-1} ∫_0^{t_j} e^{z_p (t_j - s)} (B y(s) + f(s)) ds,
//
// with y and f piecewise linear on the grid. Nothing is shared between time points: J (P+1) shifted solves (kept here,
// the paper repeats them in every iteration) and O(J^2 P n) operations an iteration. A reference, not a fast path.

#include "functional_iteration.hpp"

namespace bromwich {

void solve_literally(const DiscreteProblem&, const Options&, Result& result);

/// Σ_p c_p R(z_p) ∫_0^t e^{z_p (t-s)} ds for a scalar A = a and u = 1, exactly (e^{at} - 1)/a: what Theorem 2.3 (2)
/// bounds.
double literal_scalar_response(double a, double t, Index P);

}  // namespace bromwich

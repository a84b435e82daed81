#pragma once
// Modes that a time grid does not resolve. A method that replaces e^{h lambda} by a rational function (Radau IIA,
// implicit Euler) turns growth into decay for h Re lambda > 2 or so, and damps oscillations with h Im lambda > 1. The
// same happens with h/2, so a comparison of the two grids does not show it.

#include "discrete_problem.hpp"

#include <functional>
#include <optional>
#include <vector>

namespace bromwich {

/// The matrix of the state of dense dynamics while the set S of y is active: A - B_S M_SS^{-1} N_S, or A restricted by
/// the constraints N_S x = const. None if M_SS and (N B)_SS are both singular.
std::optional<Matrix> closed_matrix(const Matrix& A, const Matrix& B, const Matrix& N, const Matrix& M,
                                    const std::vector<Index>& S);

/// The eigenvalue lambda (1/time) of the fastest mode contained in the states x that grows noticeably while its active
/// set lasts, has h |lambda| > 1/2, and is made to decay by the method: grids may then agree in a solution without it.
/// `damping`: see below.
std::optional<Complex> damped_growth(const DiscreteProblem&, const RowMatrix& y, const RowMatrix& x,
                                     double (*damping)(Complex z));

/// lambda of the fastest weakly damped oscillation of these modes. It makes up at least a tenth of the state, and the
/// method removes or adds a third of it while its active set lasts. `damping` is log |R(z)| of the method, z = h
/// lambda.
std::optional<Complex> unresolved_oscillation(const DiscreteProblem&, const RowMatrix& y, const RowMatrix& x,
                                              double (*damping)(Complex z));

/// log |R(z)| of implicit Euler and of Radau IIA with two stages.
double euler_damping(Complex z);
double radau_damping(Complex z);

}  // namespace bromwich

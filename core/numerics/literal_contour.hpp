#pragma once
// Contours of the Laplace-inversion paper for one time point each, beside the printed one of (2.2): what its remarks
// say of e^{At} x0 and of spectra that the printed one cannot enclose.

#include "contour.hpp"

namespace bromwich {

/// gamma of the printed contour, literal_contour(): spectra have to lie in the sector of half-angle pi/2 - gamma.
inline constexpr double printed_gamma = 0.794;

/// The second contour of Remark 2.3, for e^{At} x0 with real negative spectra, as the window of one time point: gamma =
/// 1.1721, mu = 4.4921 P, dv = 1.0818/P. The paper gives the error as e^{-2.32 P}; rounding adds about eps e^{0.35 P}.
ContourParameters initial_value_parameters(Index P);

/// Remarks 2.1 and 2.4, for the eigenvalues of any real A: a hyperbola around some of them and, as (2.3), a circle
/// around each group of the others. For entire functions of A like ∫_0^t e^{A(t-s)} u(s) ds. Shift, width and angle of
/// the hyperbola minimise the error that the eigenvalues let expect: dv = sqrt(2 pi d/P) balances the nodes that are
/// left out, e^{-P dv}, with e^{-2 pi d/dv}, where d is the distance in v of the hyperbola from the nearest eigenvalue
/// or to where e^{zt} grows. The hyperbola has P + 1 nodes, a circle P on the real axis and 2 P above it.
Contour contour_around(const ComplexVector& eigenvalues, Index P, double t);

}  // namespace bromwich

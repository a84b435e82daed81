#pragma once
// Whether y -> w = M y + N x(y) is strongly monotone, which makes the solution unique: w - w' and y - y' of two
// solutions have a product that is not positive at any time, and
//
//     sigma ||y - y'||^2 <= ∫ (y - y')^T (w - w') dt <= 0.
//
// The same holds with a weight e^{-2 lambda t} in the integral; the operator is then e^{-lambda t} L e^{lambda t}, that
// of A - lambda I and E0 x(0) + e^{lambda T} ET x(T).

#include "../scene/scene.hpp"

namespace bromwich {

/// sigma = min y^T L y / y^T y over the piecewise-linear y on `steps` intervals: an upper bound of that of the
/// continuous operator, to about 1e-6 of its size. By Lanczos iteration on (L + L^T)/2; L^T is a two-point problem like
/// L, nothing is assembled.
double smallest_symmetric_eigenvalue(const Scene&, Index steps, double lambda);

}  // namespace bromwich

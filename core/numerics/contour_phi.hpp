#pragma once

#include "contour.hpp"

#include <vector>

namespace bromwich {

/// The same from shifted solves, for dense A. The contour encloses the spectrum and 0 (near_contour(., 1) or
/// circle(., 1)): phi_k(A) = 1/(2 pi i) ∮ e^z z^{-k} (zI - A)^{-1} dz.
std::vector<Matrix> contour_phis(const Matrix& A, const Contour&, int last);

}  // namespace bromwich

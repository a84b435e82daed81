#pragma once
// phi-functions of matrices of any norm whose numerical range lies in a sector around the negative real axis. Scaling
// and squaring s times multiplies rounding errors by 2^s, the norm: a slow mode beside one 10^8 times as fast keeps 8
// digits. The contour integral
//
//     phi_k(A) = 1/(2 pi i) ∮ e^z z^{-k} (zI - A)^{-1} dz
//
// treats slow and fast modes at the same nodes. Its quadrature error is at most 1 + sqrt(2) times the largest error
// over the numerical range (Crouzeix, Palencia, SIAM J. Matrix Anal. Appl. 38, 2017), also for non-normal A.

#include "../base/types.hpp"

#include <optional>
#include <vector>

namespace bromwich {

/// D^{-1} A D with rows and columns of comparable size (Osborne); D of powers of two.
struct Balanced {
  Matrix A;
  Vector D;
};
Balanced balanced(const Matrix& A);

/// The numerical range of A lies in |arg(shift - z)| <= half_angle, 0 < half_angle < pi/2.
bool in_sector(const Matrix& A, double half_angle, double shift);

/// phi_0(A), ..., phi_last(A), last <= 5, to a few roundings of their norms, with A balanced or as given. Empty if
/// neither numerical range lies in the sector of 60 degrees with its vertex at 1/4. Takes 51 or 81 inverses of complex
/// m x m matrices.
std::optional<std::vector<Matrix>> sectorial_phis(const Matrix& A, int last);

}  // namespace bromwich

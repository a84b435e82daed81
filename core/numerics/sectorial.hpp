#pragma once
// phi-functions of matrices whose numerical range lies in a sector around the negative real axis, however large their
// norm is. Scaling and squaring s times multiplies rounding by 2^s, the norm: a slow mode beside one 10^8 times as fast
// keeps 8 digits. The contour integral
//
//     phi_k(A) = 1/(2 pi i) ∮ e^z z^{-k} (zI - A)^{-1} dz
//
// sees slow and fast modes at the same nodes, and its quadrature error is at most 1 + sqrt(2) times the largest over
// the numerical range (Crouzeix, Palencia, SIAM J. Matrix Anal. Appl. 38, 2017), for non-normal A too.

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

/// phi_0(A), ..., phi_last(A), last <= 5, to some roundings of their norms, balanced or as given; empty where neither
/// numerical range lies in the sector of 60 degrees with its vertex at 1/4. 51 or 81 inverses of complex m x m
/// matrices.
std::optional<std::vector<Matrix>> sectorial_phis(const Matrix& A, int last);

}  // namespace bromwich

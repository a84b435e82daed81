#pragma once
// e^A, phi_1(A) and phi_2(A) where double precision is not enough.
//
// An algorithm in double precision returns the exponential of a matrix that differs from A by eps ||A||. A slow mode
// beside one 10^10 times as fast then has an error of 10^-6 in its rate, and over J steps the errors add up to eps
// ||A|| T. Here all products use pairs of doubles (106 bits), for a Taylor polynomial of phi_2 at 2^-s A and s
// doublings as in core/numerics/matrix_phi.cpp. The error is below eps of the entries for norms up to 10^14 and more.
// The cost is about 3 (s + 6) m^3 products of 25 operations each.

#include "matrix_phi.hpp"

namespace bromwich {

/// phi_k(h A), k = 0, 1, 2, rounded to doubles at the end. Finite A.
MatrixPhi precise_phi(const Matrix& A, double h);

}  // namespace bromwich

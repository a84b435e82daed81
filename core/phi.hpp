#pragma once
// phi_1(x) = (e^x - 1)/x and phi_2(x) = (e^x - 1 - x)/x^2, the integrals of e^{(1-s)x} against 1 and s on [0,1].

#include "types.hpp"

namespace bromwich {

double phi1(double x);
double phi2(double x);
Complex phi1(Complex x);
Complex phi2(Complex x);

/// e^z - 1 without cancellation for small z.
Complex expm1(Complex z);

/// e^A, phi_1(A) and phi_2(A) of a small dense matrix from one exponential of the 3m x 3m block matrix
/// [[A, I, 0], [0, 0, I], [0, 0, 0]] (Saad, SIAM J. Numer. Anal. 29, 1992; Higham's scaling and squaring).
struct MatrixPhi {
  Matrix exponential, phi1, phi2;
};
MatrixPhi matrix_phi(const Matrix& A);

}  // namespace bromwich

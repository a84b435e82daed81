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

/// e^A, phi_1(A) and phi_2(A) of a dense matrix. Symmetric A: by its eigenvectors, each eigenvalue on its own, so that
/// stiff and slow parts keep their digits. Small A: from one exponential of the 3m x 3m block matrix
/// [[A, I, 0], [0, 0, I], [0, 0, 0]] (Saad, SIAM J. Numer. Anal. 29, 1992; Higham's scaling and squaring). Larger A: a
/// Taylor polynomial of phi_2 at 2^-s A, then s doublings, phi_2(2X) = (phi_1(X)^2 + 2 phi_2(X))/4.
struct MatrixPhi {
  Matrix exponential, phi1, phi2;
};
MatrixPhi matrix_phi(const Matrix& A);

}  // namespace bromwich

#pragma once
// phi-functions of matrices.

#include "../base/types.hpp"

#include <vector>

namespace bromwich {

/// e^A, phi_1(A) and phi_2(A) of a dense matrix. Symmetric A: by its eigenvectors, each eigenvalue separately, so that
/// stiff and slow parts keep their accuracy. Small A: one exponential of the 3m x 3m block matrix [[A, I, 0], [0, 0,
/// I], [0, 0, 0]] (Saad, SIAM J. Numer. Anal. 29, 1992; Higham's scaling and squaring). Larger A: a Taylor polynomial
/// of phi_2 at 2^-s A, then s doublings, phi_2(2X) = (phi_1(X)^2 + 2 phi_2(X))/4. Stiff A, with a norm above 1024: a
/// contour, if the numerical range permits it (core/numerics/sectorial.hpp).
struct MatrixPhi {
  Matrix exponential, phi1, phi2;
};
MatrixPhi matrix_phi(const Matrix& A);

/// phi_0(A), ..., phi_last(A), last <= 5. Symmetric A by its eigenvectors, stiff A from a contour, as above. Otherwise
/// a Taylor polynomial of phi_last at 2^-s A, the others by phi_k = 1/k! + A phi_{k+1}, and s doublings (Koikari, Appl.
/// Numer. Math. 57, 2007): with a = floor(k/2), b = k - a,
///
///     2^k phi_k(2X) = phi_a(X) phi_b(X) + Σ_{j=a+1}^k phi_j(X)/(k-j)! + Σ_{j=b+1}^k phi_j(X)/(k-j)!.
std::vector<Matrix> matrix_phis(const Matrix& A, int last);

}  // namespace bromwich

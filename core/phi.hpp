#pragma once
// phi_0(x) = e^x and phi_k(x) = ∫_0^1 e^{(1-s)x} s^{k-1}/(k-1)! ds = Σ_j x^j/(j+k)!, so that phi_k(x) = 1/k! + x
// phi_{k+1}(x): what exponential integrators are made of.

#include "contour.hpp"
#include "types.hpp"

#include <vector>

namespace bromwich {

double phi1(double x);
double phi2(double x);
Complex phi1(Complex x);
Complex phi2(Complex x);

/// phi_k(x), k >= 0.
double phi(int k, double x);

/// e^x, phi_1(x) and phi_2(x) of many numbers at once.
struct ArrayPhi {
  Eigen::ArrayXd exponential, phi1, phi2;
};
ArrayPhi array_phi(const Eigen::ArrayXd& x);

/// e^z - 1 without cancellation for small z.
Complex expm1(Complex z);

/// e^A, phi_1(A) and phi_2(A) of a dense matrix. Symmetric A: by its eigenvectors, each eigenvalue on its own, so that
/// stiff and slow parts keep their digits. Small A: from one exponential of the 3m x 3m block matrix
/// [[A, I, 0], [0, 0, I], [0, 0, 0]] (Saad, SIAM J. Numer. Anal. 29, 1992; Higham's scaling and squaring). Larger A: a
/// Taylor polynomial of phi_2 at 2^-s A, then s doublings, phi_2(2X) = (phi_1(X)^2 + 2 phi_2(X))/4. Stiff A, of a norm
/// above 1024: from a contour where the numerical range allows (core/sectorial.hpp).
struct MatrixPhi {
  Matrix exponential, phi1, phi2;
};
MatrixPhi matrix_phi(const Matrix& A);

/// phi_0(A), ..., phi_last(A), last <= 5. Symmetric A: by its eigenvectors; stiff A from a contour, as above. Otherwise
/// a Taylor polynomial of phi_last at 2^-s A, the others by phi_k = 1/k! + A phi_{k+1}, and s doublings (Koikari, Appl.
/// Numer. Math. 57, 2007): with a = floor(k/2), b = k - a,
///
///     2^k phi_k(2X) = phi_a(X) phi_b(X) + Σ_{j=a+1}^k phi_j(X)/(k-j)! + Σ_{j=b+1}^k phi_j(X)/(k-j)!.
std::vector<Matrix> matrix_phis(const Matrix& A, int last);

/// The same from shifted solves, for dense A whose spectrum the contour holds, 0 inside of it (near_contour(., 1) or
/// circle(., 1)): phi_k(A) = 1/(2 pi i) ∮ e^z z^{-k} (zI - A)^{-1} dz.
std::vector<Matrix> contour_phis(const Matrix& A, const Contour&, int last);

}  // namespace bromwich

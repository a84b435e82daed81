#pragma once
// phi-functions of matrices.

#include "../base/types.hpp"

#include <map>
#include <memory>
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

/// The phi-functions of h A for many h and one A. A symmetric A is diagonalised once. Otherwise what a doubling makes
/// is kept: the phi-functions of h A, made from 2^-s h A, bring those of h A/2, h A/4, ..., and these need one doubling
/// for 2h A. Values agree with matrix_phi and matrix_phis up to rounding, and do not depend on the order of the calls.
/// Not for several threads at once.
class PhiFamily {
 public:
  explicit PhiFamily(Matrix A);

  /// As matrix_phi(h A).
  std::shared_ptr<const MatrixPhi> phi(double h);
  /// phi_0(h A), ..., phi_5(h A), as matrix_phis(h A, 5).
  std::shared_ptr<const std::vector<Matrix>> phis(double h);

  struct Counts {
    Index made = 0;     ///< from a series, a block matrix or a contour; one more for the diagonalisation
    Index doubled = 0;  ///< from half the step, kept or made on the way
    Index kept = 0;     ///< found
  };
  const Counts& counts() const { return counts_; }

 private:
  template <class Phis>
  using Kept = std::map<double, std::shared_ptr<const Phis>>;
  bool symmetric();
  template <class Phis, class Series, class Twice>
  std::shared_ptr<const Phis> by_doubling(Kept<Phis>&, double h, const Series&, const Twice&);
  /// The value of `kept` at h, or the one that `make` returns.
  template <class Phis, class Make>
  std::shared_ptr<const Phis> kept_or(Kept<Phis>& kept, double h, const Make& make);

  Matrix A_;
  double norm_ = 0;
  bool keeps_ = true, looked_ = false;
  Matrix V_;  ///< eigenvectors of a symmetric A
  Vector lambda_;
  Kept<MatrixPhi> three_;          ///< by h
  Kept<std::vector<Matrix>> six_;  ///< by h
  Counts counts_;
};

}  // namespace bromwich

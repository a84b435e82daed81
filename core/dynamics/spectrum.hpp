#pragma once
// Location of the eigenvalues of A, to place contours around them.

#include "../base/types.hpp"

#include <string>

namespace bromwich {

struct DenseDynamics;
struct SuppliedDynamics;

struct Spectrum {
  double half_angle = 0;    ///< of the smallest sector |arg(-z)| <= half_angle with all eigenvalues (pi if one is > 0)
  double abscissa = 0;      ///< largest real part
  double radius = 0;        ///< largest modulus
  double slowest = 0;       ///< smallest non-zero modulus, 0 if none or not known
  bool bound = false;       ///< stated by the user; radius and slowest are not known
  bool non_normal = false;  ///< dense: ||A A^T - A^T A||_F > ||A||_F^2 / 10

  bool real_negative() const { return half_angle == 0; }
  /// For example "real, moduli 0.04 to 12.8".
  std::string describe() const;
};

/// All eigenvalues by the QR algorithm.
Spectrum dense_spectrum(const DenseDynamics&);

/// The bounds and estimates used for large sparse A, for a matrix of any size.
Spectrum sparse_spectrum(const SparseMatrix& A);
/// The same of E^{-1} A, by a factorization of E.
Spectrum sparse_spectrum(const SparseMatrix& A, const SparseMatrix& E);
/// Estimates from Ritz values of (zE - A)^{-1} E at z = 1, which give the eigenvalues nearest to 1.
Spectrum supplied_spectrum(const SuppliedDynamics&);

}  // namespace bromwich

// The spectrum of a sparse A, for which eigenvalues cannot be listed:
//
//     symmetric, skew          read off the entries; half-angle 0 or pi/2 follows
//     abscissa                 0 where Gershgorin's discs say so; otherwise for symmetric A the sign of the pivots of
//                              sI - A tells whether s is above it, and for other A the Ritz values do
//     radius, half-angle       Ritz values of a Krylov space: estimates from inside the numerical range
//
// What is only estimated chooses where the contour search starts; the check of the kernel decides
// (core/kernel/sparse_kernel.hpp).

#include "core/dynamics/spectrum.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/SparseCholesky>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

// Largest real part that a disc |z - a_ii| <= Σ_j |a_ij| reaches, over rows or over columns.
double gershgorin_abscissa(const SparseMatrix& A) {
  Vector diagonal = Vector::Zero(A.rows()), rows = diagonal, columns = diagonal;
  for (Index c = 0; c < A.cols(); ++c)
    for (SparseMatrix::InnerIterator a(A, c); a; ++a) {
      if (a.row() == c) {
        diagonal[c] += a.value();
      } else {
        rows[a.row()] += std::abs(a.value());
        columns[c] += std::abs(a.value());
      }
    }
  return std::min((diagonal + rows).maxCoeff(), (diagonal + columns).maxCoeff());
}

// Eigenvalues of A projected on the Krylov space of a random vector (Arnoldi).
ComplexVector ritz_values(const SparseMatrix& A) {
  constexpr Index steps = 32;
  const Index m = A.rows(), k = std::min(m, steps);
  Matrix Q(m, k), H = Matrix::Zero(k, k);
  unsigned long long random = 1;
  for (double& value : Q.col(0)) {
    random = random * 6364136223846793005ULL + 1442695040888963407ULL;
    value = double(random >> 11) / 9007199254740992.0 - 0.5;
  }
  Q.col(0).normalize();
  const double scale = A.norm();
  for (Index j = 0; j < k; ++j) {
    Vector w = A * Q.col(j);
    for (int sweep = 0; sweep < 2; ++sweep) {
      const Vector h = Q.leftCols(j + 1).transpose() * w;
      w -= Q.leftCols(j + 1) * h;
      H.col(j).head(j + 1) += h;
    }
    const double beta = w.norm();
    if (j + 1 == k || beta <= epsilon * scale) return H.topLeftCorner(j + 1, j + 1).eigenvalues();
    H(j + 1, j) = beta;
    Q.col(j + 1) = w / beta;
  }
  return {};
}

// Smallest s on the way down from `bound` by factors of 2 with sI - A positive definite, down to rounding.
double symmetric_abscissa(const SparseMatrix& A, double bound, double rounding) {
  SparseMatrix identity(A.rows(), A.cols());
  identity.setIdentity();
  Eigen::SimplicialLLT<SparseMatrix> cholesky;
  cholesky.analyzePattern(SparseMatrix(identity - A));
  const auto above = [&](double s) {
    cholesky.factorize(SparseMatrix(s * identity - A));
    return cholesky.info() == Eigen::Success;
  };
  if (above(rounding)) return 0;
  double s = bound;
  while (s > 2 * rounding && above(s / 2)) s /= 2;
  return s;
}

}  // namespace

Spectrum sparse_spectrum(const SparseMatrix& A) {
  Spectrum s;
  if (A.nonZeros() == 0) return s;
  const SparseMatrix transposed = A.transpose();
  const double norm = A.norm(), rounding = 16 * epsilon * norm;
  const bool symmetric = (A - transposed).norm() <= rounding, skew = (A + transposed).norm() <= rounding;
  const ComplexVector ritz = ritz_values(A);
  s.radius = ritz.cwiseAbs().maxCoeff();
  const double bound = gershgorin_abscissa(A);
  if (bound <= rounding)
    s.abscissa = 0;
  else
    s.abscissa = symmetric ? symmetric_abscissa(A, bound, rounding) : skew ? 0 : std::max(0.0, ritz.real().maxCoeff());
  if (s.abscissa > 0) s.half_angle = std::numbers::pi;
  if (symmetric || s.abscissa > 0) return s;
  // Ritz values near 0 are the least accurate, and a contour is as close to 0 as it likes.
  for (const Complex theta : ritz)
    if (std::abs(theta) > 1e-3 * s.radius && std::abs(theta.imag()) > 1e-8 * s.radius)
      s.half_angle = std::max(s.half_angle, std::abs(std::arg(-theta)));
  if (skew) s.half_angle = std::numbers::pi / 2;
  return s;
}

}  // namespace bromwich

// The spectrum of a sparse A, without computing all eigenvalues:
//
//     symmetric, skew          from the entries; the half-angle is then 0 or pi/2
//     abscissa                 0 if Gershgorin's discs show it; otherwise for symmetric A the signs of the pivots of
//                              sI - A tell whether s is larger, and for other A the Ritz values are used
//     radius, half-angle       Ritz values of a Krylov space: estimates from inside the numerical range
//
// Estimates only determine the start of the search for a contour; the check of the kernel decides
// (core/kernel/sparse_kernel.hpp).

#include "core/dynamics/spectrum.hpp"

#include "core/base/error.hpp"
#include "core/dynamics/supplied.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseLU>

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

// Eigenvalues of an m x m matrix projected on the Krylov space of a random vector (Arnoldi). `scale`: its size.
template <class Product>
ComplexVector ritz_values(Index m, double scale, const Product& product) {
  constexpr Index steps = 32;
  const Index k = std::min(m, steps);
  Matrix Q(m, k), H = Matrix::Zero(k, k);
  unsigned long long random = 1;
  for (double& value : Q.col(0)) {
    random = random * 6364136223846793005ULL + 1442695040888963407ULL;
    value = double(random >> 11) / 9007199254740992.0 - 0.5;
  }
  Q.col(0).normalize();
  for (Index j = 0; j < k; ++j) {
    Vector w = product(Vector(Q.col(j)));
    if (!w.allFinite()) return {};
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

// Ritz values near 0 are the least accurate, and contours may pass arbitrarily close to 0.
double half_angle_of(const ComplexVector& ritz, double radius) {
  double angle = 0;
  for (const Complex theta : ritz)
    if (std::abs(theta) > 1e-3 * radius && std::abs(theta.imag()) > 1e-8 * radius)
      angle = std::max(angle, std::abs(std::arg(-theta)));
  return angle;
}

// Smallest s = bound/2^k for which sI - A is positive definite, down to rounding.
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
  const ComplexVector ritz = ritz_values(A.rows(), norm, [&A](const Vector& x) { return Vector(A * x); });
  s.radius = ritz.cwiseAbs().maxCoeff();
  const double bound = gershgorin_abscissa(A);
  if (bound <= rounding)
    s.abscissa = 0;
  else
    s.abscissa = symmetric ? symmetric_abscissa(A, bound, rounding) : skew ? 0 : std::max(0.0, ritz.real().maxCoeff());
  if (s.abscissa > 0) s.half_angle = std::numbers::pi;
  if (symmetric || s.abscissa > 0) return s;
  s.half_angle = half_angle_of(ritz, s.radius);
  if (skew) s.half_angle = std::numbers::pi / 2;
  return s;
}

Spectrum sparse_spectrum(const SparseMatrix& A, const SparseMatrix& E) {
  Spectrum s;
  if (A.nonZeros() == 0) return s;
  SparseMatrix mass = E;
  mass.makeCompressed();
  const Eigen::SparseLU<SparseMatrix> lu(mass);
  if (lu.info() != Eigen::Success)
    throw Error("E", "is singular", "eliminate the algebraic equations: E^{-1} A has no spectrum");
  const ComplexVector ritz = ritz_values(A.rows(), 0, [&](const Vector& x) { return Vector(lu.solve(Vector(A * x))); });
  s.radius = ritz.cwiseAbs().maxCoeff();
  const auto symmetric = [](const SparseMatrix& matrix) {
    const SparseMatrix transposed = matrix.transpose();
    return (matrix - transposed).norm() <= 16 * epsilon * matrix.norm();
  };
  // Of a symmetric pencil with E > 0 the eigenvalues are real, and negative where A is: Sylvester's law of inertia.
  if (symmetric(A) && symmetric(E) && Eigen::SimplicialLLT<SparseMatrix>(mass).info() == Eigen::Success) {
    const SparseMatrix above = 16 * epsilon * s.radius * mass - A;
    if (Eigen::SimplicialLLT<SparseMatrix>(above).info() == Eigen::Success) return s;
  }
  s.abscissa = std::max(0.0, ritz.real().maxCoeff());
  if (s.abscissa <= 1e-8 * s.radius) s.abscissa = 0;
  s.half_angle = s.abscissa > 0 ? std::numbers::pi : half_angle_of(ritz, s.radius);
  return s;
}

Spectrum supplied_spectrum(const SuppliedDynamics& d) {
  Spectrum s;
  double z = 1;  // changed if it is an eigenvalue
  ComplexVector inverse;
  for (int tries = 0; tries < 4 && inverse.size() == 0; ++tries, z *= 1.618) try {
      const ShiftedSolve solve = d.shifted(Complex(z));
      inverse = ritz_values(d.states, 0, [&](const Vector& x) {
        return Vector(solve((d.mass ? Vector(d.mass(x)) : x).cast<Complex>()).real());
      });
      if (!inverse.allFinite()) inverse.resize(0);
      if (inverse.size() > 0) break;
    } catch (const SingularShift&) {
    }
  if (inverse.size() == 0)
    throw Error("shifted", "has no finite solution for real shifts near 1", "give a bound of the spectrum");
  const double largest = inverse.cwiseAbs().maxCoeff();
  ComplexVector ritz(inverse.size());
  Index count = 0;
  for (const Complex theta : inverse)
    if (std::abs(theta) > 1e-6 * largest) ritz[count++] = z - 1.0 / theta;
  ritz.conservativeResize(count);
  s.radius = ritz.cwiseAbs().maxCoeff();
  s.abscissa = std::max(0.0, ritz.real().maxCoeff());
  if (s.abscissa <= 1e-8 * s.radius) s.abscissa = 0;
  s.half_angle = s.abscissa > 0 ? std::numbers::pi : half_angle_of(ritz, s.radius);
  return s;
}

}  // namespace bromwich

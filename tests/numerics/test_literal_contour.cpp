// The contours of the remarks of the Laplace-inversion paper against dense exponentials.

#include "core/numerics/literal_contour.hpp"
#include "tests/support/oracle.hpp"

#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

double rate(Index P) { return std::exp(-2.06 * std::sqrt(double(P))) / std::sqrt(double(P)); }

/// Re Σ_p c_p F(z_p) (z_p I - A)^{-1}.
template <class F>
Matrix integral(const Contour& contour, const Matrix& A, const F& factor) {
  const ComplexMatrix unit = ComplexMatrix::Identity(A.rows(), A.cols());
  ComplexMatrix sum = ComplexMatrix::Zero(A.rows(), A.cols());
  for (Index p = 0; p < contour.nodes.size(); ++p) {
    const Complex z = contour.nodes[p];
    sum += contour.weights[p] * factor(z) * ComplexMatrix(z * unit - A.cast<Complex>()).inverse();
  }
  return sum.real();
}

/// The error of ∫_0^t e^{A(t-s)} ds, relative to t or to the integral where that grows.
double error_around(const Matrix& A, Index P, double t) {
  const ComplexVector eigenvalues = Eigen::EigenSolver<Matrix>(A, false).eigenvalues();
  const Matrix exact = t * oracle::phi_functions(t * A).phi1;
  const Matrix found =
      integral(contour_around(eigenvalues, P, t), A, [&](Complex z) { return (std::exp(z * t) - 1.0) / z; });
  return (found - exact).cwiseAbs().maxCoeff() / std::max(t, exact.cwiseAbs().maxCoeff());
}

Matrix damped(double degrees) { return Matrix{{0, 1}, {-1, -2 * std::cos(degrees * std::numbers::pi / 180)}}; }

// Zero, imaginary, unstable eigenvalues, defective ones, and angles above 44.5 degrees. The expected error of the
// search is that of three equal parts, e^{-delta sqrt P} with delta above 1.7 for eigenvalues that a circle may take:
// twenty times the printed rate, P = 16 to 64, is e^{0.36 sqrt P} of it and a constant of 4, as of
// LiteralContour.HasThePrintedRate.
TEST(ContourAround, GivesTheIntegralOfDenseExponentials) {
  Matrix both = Matrix::Zero(4, 4);
  both.topLeftCorner(2, 2) = damped(90);
  both.bottomRightCorner(2, 2) << 0, 1, 0, 0;
  both.bottomLeftCorner(2, 2).setOnes();
  const Matrix one{{-3}}, pendulum{{0, 1}, {4, 0}}, leaving{{1.5, 1}, {0, -4}};
  for (const Matrix& A : {one, pendulum, leaving, both, damped(44.5), damped(60), damped(70), damped(85), damped(90)})
    for (const Index P : {16, 25, 64})
      for (const double t : {1e-3, 0.01, 0.1, 0.5, 1.0, 2.0, 4.0, 10.0, 30.0})
        EXPECT_LE(error_around(A, P, t), 20 * rate(P)) << A << "\nP = " << P << ", t = " << t;
}

// Only A t matters, so units of time do not.
TEST(ContourAround, ScalesWithTime) {
  for (const double scale : {1e-6, 1e6})
    EXPECT_NEAR(error_around(scale * damped(85), 25, 3 / scale), error_around(damped(85), 25, 3), 1e-12);
}

TEST(InitialValueContour, HasThePrintedRate) {
  for (const Index P : {4, 6, 8, 10, 12, 14}) {
    const Contour contour = window_contour(initial_value_parameters(P), 1);
    double worst = 0;
    for (int i = 0; i <= 500; ++i) {
      const double a = -std::pow(10.0, -3 + i / 50.0);
      const Matrix found = integral(contour, Matrix{{a}}, [](Complex z) { return std::exp(z); });
      worst = std::max(worst, std::abs(found(0, 0) - std::exp(a)));
    }
    // O(e^{-2.32 P}); the sum has rounding of eps e^{z_0}, z_0 = 4.4921 (1 - sin 1.1721) P = 0.353 P.
    EXPECT_LE(worst, 4 * std::exp(-2.32 * double(P)) + 4 * epsilon * std::exp(0.353 * double(P))) << "P = " << P;
    EXPECT_GE(worst, std::exp(-2.32 * double(P)) / 4) << "P = " << P;
  }
}

}  // namespace
}  // namespace bromwich

// phi_1 and phi_2 against extended precision; matrix functions against quadrature of their integrals.

#include "core/numerics/contour_phi.hpp"
#include "core/numerics/matrix_phi.hpp"
#include "core/numerics/phi.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>
#include <Eigen/Dense>

#include <functional>

namespace bromwich {
namespace {

using reference::Real;
using LongComplex = std::complex<Real>;

/// Σ_k z^k/(k+first)!: at |z| <= 3 cancellation costs at most e^6 of 1e-19.
LongComplex series(LongComplex z, int first) {
  Real factorial = 1;
  for (int k = 2; k <= first; ++k) factorial *= Real(k);
  LongComplex term = 1 / factorial, sum = 0;
  for (int k = first + 1; k < first + 60; ++k) {
    sum += term;
    term *= z / Real(k);
  }
  return sum;
}

LongComplex phi1_reference(LongComplex z) { return std::abs(z) <= 3 ? series(z, 1) : (std::exp(z) - Real(1)) / z; }
LongComplex phi2_reference(LongComplex z) {
  return std::abs(z) <= 3 ? series(z, 2) : (std::exp(z) - Real(1) - z) / (z * z);
}

const std::vector<double> magnitudes{1e-300, 1e-16, 1e-8, 1e-3, 0.3, 0.999, std::nextafter(1.0, 0.0),
                                     1.0,    1.001, 2.5,  17,   300};

TEST(Phi, RealValuesToRounding) {
  for (double magnitude : magnitudes)
    for (const double x : {magnitude, -magnitude}) {
      // A handful of roundings; at |x| >= 1 phi1 - 1 loses a factor 2 at most.
      EXPECT_NEAR(phi1(x) / double(reference::phi1(x)), 1, 4 * epsilon) << x;
      EXPECT_NEAR(phi2(x) / double(reference::phi2(x)), 1, 8 * epsilon) << x;
    }
  EXPECT_EQ(phi1(0.0), 1);
  EXPECT_EQ(phi2(0.0), 0.5);
  EXPECT_NEAR(phi1(-1e6) * 1e6, 1, 4 * epsilon);
  EXPECT_NEAR(phi2(-1e6) * 1e12, 1e6 - 1, 4e6 * epsilon);
}

TEST(Phi, ManyValuesToRounding) {
  for (const double magnitude : magnitudes)
    for (const double x : {magnitude, -magnitude}) {
      const ArrayPhi phi = array_phi(Eigen::ArrayXd::Constant(11, x));  // full SIMD vectors and a remainder
      for (const Index i : {0, 10}) {
        // 1 + x phi_1 of x near -1 loses a factor e; vectorised exponentials are good to a few roundings.
        EXPECT_NEAR(phi.exponential[i] / double(std::exp(Real(x))), 1, 16 * epsilon) << x;
        EXPECT_NEAR(phi.phi1[i] / double(reference::phi1(x)), 1, 8 * epsilon) << x;
        EXPECT_NEAR(phi.phi2[i] / double(reference::phi2(x)), 1, 12 * epsilon) << x;
      }
    }
  const ArrayPhi at_zero = array_phi(Eigen::ArrayXd::Zero(3));
  EXPECT_EQ(at_zero.phi1[0], 1);
  EXPECT_EQ(at_zero.phi2[2], 0.5);
}

TEST(Phi, ComplexValuesToRounding) {
  for (double magnitude : magnitudes) {
    if (magnitude > 100) continue;
    for (int k = 0; k < 16; ++k) {
      const Complex z = std::polar(magnitude, k * std::numbers::pi / 8);
      const LongComplex wide(z.real(), z.imag());
      const double size = std::abs(z), growth = std::exp(std::max(z.real(), 0.0));
      // Both are integrals of e^{uz} over [0,1] with weights up to 1. Below |z| = 1: a few roundings of values near 1;
      // above: of e^z/z, divided again for phi2. sin and cos of |z| <= 17 are accurate to one rounding.
      const double scale = size < 1 ? growth : (growth + 1) / size, scale2 = size < 1 ? growth : (scale + 1) / size;
      EXPECT_LE(double(std::abs(LongComplex(phi1(z)) - phi1_reference(wide))), 8 * epsilon * scale) << z;
      EXPECT_LE(double(std::abs(LongComplex(phi2(z)) - phi2_reference(wide))), 8 * epsilon * scale2) << z;
      // Relative to the result: expm1 does not cancel at 0.
      const LongComplex grown = wide * phi1_reference(wide);
      EXPECT_LE(double(std::abs(LongComplex(expm1(z)) - grown)),
                8 * epsilon * (size < 1 ? double(std::abs(grown)) : growth + 1))
          << z;
    }
  }
  EXPECT_EQ(phi1(Complex(0)), Complex(1));
  EXPECT_EQ(phi2(Complex(0)), Complex(0.5));
}

TEST(Phi, RealAndComplexAgree) {
  for (const double x : {-1e6, -30.0, -1.0, -0.5, -1e-9, 1e-9, 0.5, 1.0, 30.0}) {
    EXPECT_NEAR(phi1(Complex(x)).real() / phi1(x), 1, 4 * epsilon) << x;
    EXPECT_NEAR(phi2(Complex(x)).real() / phi2(x), 1, 8 * epsilon) << x;
    EXPECT_EQ(phi1(Complex(x)).imag(), 0) << x;
  }
}

/// ∫_0^1 f by five-point Gauss-Legendre on 200 panels: exact to rounding for e^{-40 u} u^k.
Real integral(const std::function<Real(Real)>& f) {
  const Real a = std::sqrt(5 - 2 * std::sqrt(10 / 7.L)) / 3, b = std::sqrt(5 + 2 * std::sqrt(10 / 7.L)) / 3;
  const Real wa = (322 + 13 * std::sqrt(70.L)) / 900, wb = (322 - 13 * std::sqrt(70.L)) / 900;
  Real sum = 0;
  const int panels = 200;
  for (int i = 0; i < panels; ++i) {
    const auto at = [&](Real x) { return f((Real(i) + (1 + x) / 2) / panels); };
    sum += 128 / 225.L * at(0) + wa * (at(a) + at(-a)) + wb * (at(b) + at(-b));
  }
  return sum / 2 / panels;
}

TEST(MatrixPhi, JordanBlocks) {
  // f(J)_{i,i+k} = f^{(k)}(lambda)/k!, and phi_1^{(k)}/k! = ∫ u^k/k! e^{lambda u} du, phi_2 the same with 1-u.
  for (const Index m : {1, 2, 3, 8})
    for (const Real lambda : {0.0L, -0.3L, 1.0L, -2.0L, -40.0L}) {
      Matrix A = Matrix::Zero(m, m);
      A.diagonal().setConstant(double(lambda));
      if (m > 1) A.diagonal(1).setOnes();
      const MatrixPhi phi = matrix_phi(A);
      Real factorial = 1;
      for (Index k = 0; k < m; ++k) {
        if (k > 0) factorial *= Real(k);
        const auto power = [&](Real u) { return std::pow(u, Real(k)) / factorial * std::exp(lambda * u); };
        const double e = double(std::exp(lambda) / factorial), p1 = double(integral(power)),
                     p2 = double(integral([&](Real u) { return (1 - u) * power(u); }));
        for (Index i = 0; i + k < m; ++i) {
          // Scaling and squaring of a norm up to 41: six squarings, each at most doubles errors of about 16 eps.
          EXPECT_NEAR(phi.exponential(i, i + k), e, 1e-13) << m << ' ' << double(lambda);
          EXPECT_NEAR(phi.phi1(i, i + k), p1, 1e-13) << m << ' ' << double(lambda);
          EXPECT_NEAR(phi.phi2(i, i + k), p2, 1e-13) << m << ' ' << double(lambda);
        }
      }
    }
}

TEST(MatrixPhi, DiagonalisableMatrices) {
  reference::Random random(7);
  for (const Index m : {1, 5, 16, 33}) {
    const Matrix V = Matrix::Identity(m, m) + 0.4 / double(m) * random.matrix(m, m), inverse = V.inverse();
    Vector lambda(m), e(m), p1(m), p2(m);
    for (Index i = 0; i < m; ++i) {
      lambda[i] = i == 0 ? 0 : random.uniform(-50, 1);
      e[i] = double(std::exp(Real(lambda[i])));
      p1[i] = double(reference::phi1(lambda[i]));
      p2[i] = double(reference::phi2(lambda[i]));
    }
    const MatrixPhi phi = matrix_phi(V * lambda.asDiagonal() * inverse);
    // Norm 50, cond(V) < 3: A itself is off by eps ||A|| cond, and six squarings amplify a few eps each.
    const double tolerance = 2e-13;
    EXPECT_LE((phi.exponential - V * e.asDiagonal() * inverse).cwiseAbs().maxCoeff(), tolerance) << m;
    EXPECT_LE((phi.phi1 - V * p1.asDiagonal() * inverse).cwiseAbs().maxCoeff(), tolerance) << m;
    EXPECT_LE((phi.phi2 - V * p2.asDiagonal() * inverse).cwiseAbs().maxCoeff(), tolerance) << m;
  }
}

// Eigenvalues from -1e8 to 0: the slow ones keep their digits up to the rounding of the entries (eps 1e8).
TEST(MatrixPhi, StiffSymmetricMatrices) {
  const Vector v = Vector::LinSpaced(6, 1, 6), lambda{{-1e8, -1e4, -1e2, -1, -1e-4, 0}};
  const Matrix V = Matrix::Identity(6, 6) - 2 * v * v.transpose() / v.squaredNorm();
  const MatrixPhi phi = matrix_phi(V * lambda.asDiagonal() * V.transpose());
  const auto exact = [&](double (*f)(double)) -> Matrix {
    return V * lambda.unaryExpr(f).asDiagonal() * V.transpose();
  };
  const double tolerance = 4 * epsilon * 1e8;
  EXPECT_LE((phi.exponential - exact(+[](double x) { return std::exp(x); })).norm(), tolerance);
  EXPECT_LE((phi.phi1 - exact(+[](double x) { return double(reference::phi1(x)); })).norm(), tolerance);
  EXPECT_LE((phi.phi2 - exact(+[](double x) { return double(reference::phi2(x)); })).norm(), tolerance);
}

// Nilpotent: the series terminate. Above 16 rows the doublings must reproduce this.
TEST(MatrixPhi, LongShifts) {
  for (const Index m : {16, 17, 40}) {
    Matrix A = Matrix::Zero(m, m);
    A.diagonal(1).setConstant(3);
    const MatrixPhi phi = matrix_phi(A);
    double power = 1;  // 3^k / k!
    for (Index k = 0; k < m; power *= 3 / double(++k)) {
      EXPECT_NEAR(phi.exponential(0, k), power, 1e-14) << m << ' ' << k;
      EXPECT_NEAR(phi.phi1(0, k), power / double(k + 1), 1e-14) << m << ' ' << k;
      EXPECT_NEAR(phi.phi2(0, k), power / double((k + 1) * (k + 2)), 1e-14) << m << ' ' << k;
    }
  }
}

// ∫_0^1 e^{(1-s)x} s^{k-1}/(k-1)! ds.
double phi_by_quadrature(int k, double x) {
  Real factorial = 1;
  for (int j = 2; j < k; ++j) factorial *= Real(j);
  return double(integral([&](Real s) { return std::exp((1 - s) * Real(x)) * std::pow(s, Real(k - 1)) / factorial; }));
}

TEST(Phi, HigherFunctions) {
  for (const double x : {-35.0, -3.0, -1.0, -0.999, -1e-3, 0.0, 1e-9, 0.5, 0.999, 1.0, 2.0, 9.0})
    for (int k = 1; k <= 6; ++k) {
      // Every division by x >= 1 leaves a few roundings of phi_1 <= max(1, e^x/x).
      const double scale = std::max(1.0, std::exp(x));
      EXPECT_NEAR(phi(k, x), phi_by_quadrature(k, x), 8 * epsilon * scale) << k << ' ' << x;
    }
  EXPECT_EQ(phi(0, 2.0), std::exp(2.0));
}

// Stiff, zero, nilpotent, non-normal and oscillating: three independent methods.
TEST(MatrixPhi, HigherFunctionsFromSquaringAndFromContours) {
  Matrix nilpotent = Matrix::Zero(4, 4), non_normal = -Matrix::Identity(8, 8), stiff(3, 3);
  nilpotent.diagonal(1).setConstant(2);
  non_normal.diagonal(1).setConstant(-3);
  stiff << -1000, 1, 0, 2, -10, 1, 0, 0, -0.1;
  struct Case {
    Matrix A;
    Contour contour;
    double tolerance;  ///< of the contour
  };
  // near_contour is designed for double poles at 0, to 1e-14; up to the power -6 and for resolvents of norm 10 it loses
  // two digits. The circle of radius 6 amplifies rounding by e^6 = 4e2.
  const Contour near = near_contour(*contour_parameters(0.26), 1), round = *circle(3, 1);
  const std::vector<Case> cases{{Matrix::Zero(2, 2), round, 1e-12},
                                {nilpotent, round, 1e-12},
                                {non_normal, *circle(4, 1), 1e-11},
                                {Matrix{{0, 3}, {-3, 0}}, round, 1e-12},
                                {stiff, near, 1e-11}};
  for (const auto& [A, contour, tolerance] : cases) {
    const Index m = A.rows();
    const std::vector<Matrix> squared = matrix_phis(A, 5), from_contour = contour_phis(A, contour, 5);
    Matrix block = Matrix::Zero(6 * m, 6 * m);
    block.topLeftCorner(m, m) = A;
    for (int k = 0; k < 5; ++k) block.block(k * m, (k + 1) * m, m, m) += Matrix::Identity(m, m);
    const Matrix e = oracle::exponential(block);
    for (int k = 0; k <= 5; ++k) {
      const Matrix &p = squared[std::size_t(k)], reference = e.block(0, k * m, m, m);
      const double size = std::max(1.0, reference.cwiseAbs().maxCoeff());
      EXPECT_LE((p - reference).cwiseAbs().maxCoeff(), 1e-13 * size) << k << "\n" << A;
      EXPECT_LE((p - from_contour[std::size_t(k)]).cwiseAbs().maxCoeff(), tolerance * size) << k << "\n" << A;
    }
  }
}

TEST(MatrixPhi, HigherFunctionsOfStiffSymmetricMatrices) {
  const Vector v = Vector::LinSpaced(6, 1, 6), lambda{{-1e8, -1e4, -1e2, -1, -1e-4, 0}};
  const Matrix V = Matrix::Identity(6, 6) - 2 * v * v.transpose() / v.squaredNorm();
  const std::vector<Matrix> p = matrix_phis(V * lambda.asDiagonal() * V.transpose(), 4);
  for (int k = 0; k <= 4; ++k) {
    const Matrix exact = V * lambda.unaryExpr([k](double x) { return phi(k, x); }).asDiagonal() * V.transpose();
    EXPECT_LE((p[std::size_t(k)] - exact).norm(), 4 * epsilon * 1e8) << k;
  }
}

TEST(MatrixPhi, RecurrencesAndEmptyMatrix) {
  const Matrix A = 3 * reference::Random(3).matrix(13, 13);
  const MatrixPhi phi = matrix_phi(A);
  const Matrix one = Matrix::Identity(13, 13);
  // Products with ||A|| < 40 and values up to e^10: relative to the largest term.
  const double scale = phi.exponential.norm() * A.norm();
  EXPECT_LE((one + A * phi.phi1 - phi.exponential).norm(), 1e-14 * scale);
  EXPECT_LE((one + A * phi.phi2 - phi.phi1).norm(), 1e-14 * scale);
  EXPECT_EQ(matrix_phi(Matrix(0, 0)).phi2.size(), 0);
}

}  // namespace
}  // namespace bromwich

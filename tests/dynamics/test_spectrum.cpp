#include "core/dynamics/spectrum.hpp"
#include "core/numerics/orthogonal_factor.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>
#include <Eigen/Dense>

namespace bromwich {
namespace {

Spectrum of(const Matrix& A) {
  return spectrum(DenseDynamics{A, Matrix::Zero(A.rows(), 1), Matrix::Zero(1, A.rows())});
}

/// Q diag Q^T with a random orthogonal Q.
Matrix rotated(const Vector& lambda, std::uint32_t seed) {
  const Matrix Q =
      orthogonal_factor(reference::Random(seed).matrix(lambda.size(), lambda.size()).householderQr().householderQ());
  return Q * lambda.asDiagonal() * Q.transpose();
}

TEST(Spectrum, RealAndNegative) {
  for (const Index m : {1, 2, 7, 64}) {
    const Vector lambda = -Vector::LinSpaced(m, 0.5, 12.5);
    const Spectrum s = of(rotated(lambda, std::uint32_t(m)));
    EXPECT_EQ(s.half_angle, 0) << "imaginary parts at rounding level count as zero, m = " << m;
    EXPECT_TRUE(s.real_negative());
    // The QR algorithm is backward stable: eigenvalues of a normal matrix move by a few m eps ||A||.
    const double tolerance = 4 * double(m) * epsilon * 12.5 * std::sqrt(double(m));
    EXPECT_NEAR(s.abscissa, lambda.maxCoeff(), tolerance);
    EXPECT_NEAR(s.radius, -lambda.minCoeff(), tolerance);
    EXPECT_NEAR(s.slowest, -lambda.maxCoeff(), tolerance);
    EXPECT_NE(s.describe().find("real"), std::string::npos);
  }
}

TEST(Spectrum, HalfAngles) {
  for (const double degrees : {1.0, 30.0, 45.0, 60.0, 89.0}) {
    const double angle = degrees * std::numbers::pi / 180, a = 3 * std::cos(angle), b = 3 * std::sin(angle);
    Matrix A = Matrix::Zero(3, 3);
    A.topLeftCorner(2, 2) << -a, b, -b, -a;
    A(2, 2) = -7;
    const Spectrum s = of(A);
    EXPECT_NEAR(s.half_angle, angle, 1e-14);  // a few roundings of an angle of size 1
    EXPECT_NEAR(s.abscissa, -a, 1e-14 * 3);
    EXPECT_NEAR(s.slowest, 3, 1e-14 * 3);
    EXPECT_NEAR(s.radius, 7, 1e-14 * 7);
    EXPECT_FALSE(s.real_negative());
    EXPECT_NE(s.describe().find("sector"), std::string::npos);
  }
}

TEST(Spectrum, ZeroEigenvalues) {
  const Spectrum nothing = of(Matrix::Zero(3, 3));
  EXPECT_EQ(nothing.half_angle, 0);
  EXPECT_EQ(nothing.slowest, 0);
  EXPECT_EQ(nothing.radius, 0);
  const Spectrum some = of(rotated(Vector{{0, 0, -2, -5}}, 3));
  EXPECT_TRUE(some.real_negative()) << "zeros up to rounding have no direction";
  EXPECT_NEAR(some.slowest, 2, 1e-14 * 5);
  EXPECT_NEAR(some.abscissa, 0, 16 * epsilon * 8);  // the threshold below which an eigenvalue counts as zero
  EXPECT_EQ(of(Matrix(0, 0)).radius, 0);
}

TEST(Spectrum, ImaginaryAndUnstable) {
  const Spectrum oscillator = of(Matrix{{0, 1}, {-4, 0}});
  EXPECT_NEAR(oscillator.half_angle, std::numbers::pi / 2, 1e-15);
  EXPECT_NEAR(oscillator.radius, 2, 1e-15);
  const Spectrum growing = of(Matrix{{1, 0}, {0, -1}});
  EXPECT_DOUBLE_EQ(growing.half_angle, std::numbers::pi);
  EXPECT_DOUBLE_EQ(growing.abscissa, 1);
  EXPECT_NE(growing.describe().find("unstable"), std::string::npos);
  const Spectrum spiral = of(Matrix{{1, 1}, {-1, 1}});
  EXPECT_NEAR(spiral.half_angle, 3 * std::numbers::pi / 4, 1e-15);
}

TEST(Spectrum, DefectiveBlocksStayReal) {
  Matrix A = Matrix::Zero(4, 4);
  A.diagonal().setConstant(-1);
  A.diagonal(1).setConstant(10);
  EXPECT_EQ(of(A).half_angle, 0);  // triangular: the eigenvalues are the diagonal
}

TEST(Spectrum, KroneckerSumAgainstDense) {
  for (const auto& [along, across] : {std::pair<Index, Index>{1, 1}, {1, 5}, {7, 3}, {8, 8}}) {
    const KroneckerDynamics d = reference::signorini_dynamics(along, across, 0.3);
    const Spectrum s = spectrum(d);
    const Vector lambda = Eigen::SelfAdjointEigenSolver<Matrix>(to_dense(Dynamics(d)).A).eigenvalues();
    const double tolerance = 1e-14 * lambda.cwiseAbs().maxCoeff();  // symmetric: a few eps ||A||
    EXPECT_EQ(s.half_angle, 0);
    EXPECT_NEAR(s.abscissa, lambda.maxCoeff(), tolerance);
    EXPECT_NEAR(s.slowest, -lambda.maxCoeff(), tolerance);
    EXPECT_NEAR(s.radius, -lambda.minCoeff(), tolerance);
  }
}

TEST(Spectrum, IsThatOfThePencil) {
  const Matrix E{{2, 1}, {0, 3}}, A{{-1, 0.5}, {0, -2}};  // eigenvalues -1/2 and -2/3
  const Spectrum s = spectrum(DenseDynamics{A, Matrix(2, 1), Matrix(1, 2), E});
  EXPECT_NEAR(s.radius, 2.0 / 3, 1e-14);
  EXPECT_NEAR(s.slowest, 0.5, 1e-14);
  EXPECT_EQ(spectrum(DenseDynamics{A, Matrix(2, 1), Matrix(1, 2), Matrix::Ones(2, 2)}).radius, 0)
      << "singular: not known";
}

}  // namespace
}  // namespace bromwich

// phi-functions of stiff nonsymmetric matrices: contours against closed forms and extended precision.

#include "core/numerics/sectorial.hpp"

#include "core/numerics/matrix_phi.hpp"
#include "core/numerics/phi.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>
#include <Eigen/Dense>
#include <unsupported/Eigen/MatrixFunctions>

#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

using reference::Real;
using LongMatrix = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic>;
constexpr double sixty_degrees = std::numbers::pi / 3;

// x'' + c x' + x = 0 with rates a and b, a b = 1, a + b = -c: phi(A) = phi(a) I + (phi(b) - phi(a))/(b - a) (A - a I),
// written without cancellation.
Matrix oscillator_phi(int k, double c) {
  const double b = -(c + std::sqrt(c * c - 4)) / 2, a = 1 / b, phi_a = phi(k, a), phi_b = phi(k, b);
  return Matrix{{b * phi_a - a * phi_b, phi_b - phi_a}, {phi_a - phi_b, b * phi_b - a * phi_a}} / (b - a);
}

// The contour's 6e-15, and some roundings of sums of 51 terms, at every stiffness. Below a norm of 1024 squaring is
// used, which costs up to that many roundings.
TEST(Sectorial, OverdampedOscillator) {
  for (const double c : {10., 1e3, 1e5, 1e8, 1e12}) {
    const Matrix A{{0, 1}, {-1, -c}};
    const std::vector<Matrix> p = matrix_phis(A, 5);
    const MatrixPhi three = matrix_phi(A);
    const double tolerance = c < 1024 ? 1024 * epsilon : 2e-14;
    for (int k = 0; k <= 5; ++k)
      EXPECT_LE((p[std::size_t(k)] - oscillator_phi(k, c)).cwiseAbs().maxCoeff(), tolerance) << c << ' ' << k;
    EXPECT_LE((three.exponential - oscillator_phi(0, c)).cwiseAbs().maxCoeff(), tolerance) << c;
    EXPECT_LE((three.phi1 - oscillator_phi(1, c)).cwiseAbs().maxCoeff(), tolerance) << c;
    EXPECT_LE((three.phi2 - oscillator_phi(2, c)).cwiseAbs().maxCoeff(), tolerance) << c;
  }
}

// phi_k(A) from the exponential of [[A, I, 0], [0, 0, I], ...] in 64 bits of mantissa.
std::vector<Matrix> extended_phis(const Matrix& A, int last) {
  const Index m = A.rows();
  LongMatrix block = LongMatrix::Zero((last + 1) * m, (last + 1) * m);
  block.topLeftCorner(m, m) = A.cast<Real>();
  for (int k = 0; k < last; ++k) block.block(k * m, (k + 1) * m, m, m) += LongMatrix::Identity(m, m);
  const LongMatrix e = block.exp();
  std::vector<Matrix> p;
  for (int k = 0; k <= last; ++k) p.push_back(e.block(0, k * m, m, m).cast<double>());
  return p;
}

// Squaring 17 times in extended precision leaves 2^17 2^-64 = 7e-15 of each entry and its neighbours; in double 2e-11.
TEST(Sectorial, ContoursAgreeWithExtendedPrecision) {
  reference::Random random(11);
  const Index m = 4;
  const Matrix K = random.matrix(m, m), C = random.matrix(m, m), none = Matrix::Zero(m, m);
  Matrix mechanical(2 * m, 2 * m), ladder = Matrix::Zero(6, 6), graded(3, 3), oscillating(3, 3);
  mechanical << none, Matrix::Identity(m, m), -K * K.transpose(), -1e4 * C * C.transpose();
  for (Index i = 0; i < 6; ++i) {  // capacities from 1 to 10^-5
    ladder(i, i) = -2 * std::pow(10, double(i));
    if (i > 0) ladder(i, i - 1) = std::pow(10, double(i));
    if (i < 5) ladder(i, i + 1) = std::pow(10, double(i));
  }
  graded << -1e5, 1, 0.5, 2, -10, 1, 0, 0.3, -0.1;
  oscillating << -1e5, 3e4, 0, -3e4, -1e5, 1, 1, 1, -1;
  Matrix non_normal = -1e4 * Matrix::Identity(7, 7);
  non_normal.diagonal(1).setConstant(6e3);
  non_normal(5, 6) = 1;
  non_normal(6, 6) = -1e-2;
  for (const Matrix& A : {mechanical, ladder, graded, oscillating, non_normal}) {
    const auto contour = sectorial_phis(A, 5);
    ASSERT_TRUE(contour) << A;
    const std::vector<Matrix> exact = extended_phis(A, 5), taken = matrix_phis(A, 5);
    for (std::size_t k = 0; k <= 5; ++k) {
      const double size = exact[k].cwiseAbs().maxCoeff();
      EXPECT_LE(((*contour)[k] - exact[k]).cwiseAbs().maxCoeff(), 2e-13 * size) << k << "\n" << A;
      EXPECT_EQ((taken[k] - (*contour)[k]).cwiseAbs().maxCoeff(), 0);
    }
  }
}

// A Jordan block of -1 with 3 above: its numerical range extends to the right of 0, so squaring is used.
TEST(Sectorial, NumericalRangesThatReachTooFarAreRefused) {
  Matrix A = -1e4 * Matrix::Identity(4, 4);
  A.diagonal(1).setConstant(3e4);
  A(3, 0) = 1e4;  // otherwise balancing would shrink the entries above the diagonal
  EXPECT_FALSE(sectorial_phis(A, 4));
  EXPECT_FALSE(sectorial_phis(Matrix{{0, 3000}, {-3000, 0}}, 4));
  EXPECT_FALSE(sectorial_phis(Matrix{{2000}}, 4));
}

TEST(Sectorial, NumericalRangeOfNormalMatrices) {
  // The segment between a ± bi: half-angle atan(b/a), or atan(b/(a + s)) seen from a shift s.
  const Matrix A{{-3, 2}, {-2, -3}};
  const double exact = std::atan2(2, 3);
  EXPECT_FALSE(in_sector(A, exact - 1e-3, 0));
  EXPECT_TRUE(in_sector(A, exact + 1e-3, 0));
  EXPECT_TRUE(in_sector(A, std::atan2(2, 4) + 1e-3, 1));
  EXPECT_FALSE(in_sector(Matrix{{0.5}}, sixty_degrees, 0.25));
  EXPECT_TRUE(in_sector(Matrix{{0.2}}, sixty_degrees, 0.25));
}

TEST(Sectorial, BalancingChangesUnitsOnly) {
  reference::Random random(12);
  const Matrix A = random.matrix(5, 5);
  Vector units(5);
  units << 1, 1e6, 1e-3, 1e-9, 40;
  const Balanced b = balanced(units.asDiagonal() * A * units.cwiseInverse().asDiagonal());
  EXPECT_LE((b.D.asDiagonal() * b.A * b.D.cwiseInverse().asDiagonal() -
             units.asDiagonal() * A * units.cwiseInverse().asDiagonal())
                .cwiseAbs()
                .maxCoeff(),
            0);  // powers of two
  for (Index i = 0; i < 5; ++i) {
    const double own = std::abs(b.A(i, i)), row = b.A.row(i).cwiseAbs().sum() - own,
                 column = b.A.col(i).cwiseAbs().sum() - own;
    EXPECT_LE(std::max(row / column, column / row), 4) << i;
  }
  const Matrix triangular{{1, 2}, {0, 3}};
  EXPECT_EQ(balanced(triangular).D, Vector::Ones(2));
}

}  // namespace
}  // namespace bromwich

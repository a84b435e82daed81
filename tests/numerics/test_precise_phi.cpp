// e^{hA} where double precision loses slow modes beside fast ones.

#include "core/numerics/precise_phi.hpp"

#include "core/kernel/recurrence.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace bromwich {
namespace {

Matrix random_matrix(std::mt19937& random, Index m) {
  std::normal_distribution<double> normal;
  return Matrix::NullaryExpr(m, m, [&] { return normal(random); });
}

// Both are accurate to some eps of the largest entries of e^{|hA|}.
TEST(PrecisePhi, EqualsTheOtherWayWhereThatIsGood) {
  std::mt19937 random(1);
  for (const Index m : {1, 2, 3, 5, 8, 17})
    for (const double h : {0.01, 0.3, 1.0, 3.0}) {
      const Matrix A = random_matrix(random, m);
      const MatrixPhi a = precise_phi(A, h), b = matrix_phi(h * A);
      const double size = (h * A.cwiseAbs()).cwiseAbs().colwise().sum().maxCoeff();
      const double bound = 100 * epsilon * double(m) * (1 + size) * std::max(1.0, a.exponential.cwiseAbs().maxCoeff());
      EXPECT_LE((a.exponential - b.exponential).cwiseAbs().maxCoeff(), bound * std::exp(std::min(size, 3.0)));
      EXPECT_LE((a.phi1 - b.phi1).cwiseAbs().maxCoeff(), bound * std::exp(std::min(size, 3.0)));
      EXPECT_LE((a.phi2 - b.phi2).cwiseAbs().maxCoeff(), bound * std::exp(std::min(size, 3.0)));
    }
}

// V diag(slow, fast) V^{-1} with V = [[1, 1], [1, -2]]: A = [[-a, a], [2a, -2a - s]] up to the choice of a and s, whose
// slow rate follows from trace and determinant without cancellation.
TEST(PrecisePhi, KeepsTheSlowModeBesideAFastOne) {
  for (const double a : {1e6, 1e10, 1e13})
    for (const double h : {1e-3, 0.5}) {
      const double fast_row = -2 * a - 1;  // exact for these a
      const Matrix A{{-a, a}, {2 * a, fast_row}};
      // det = a(2a + 1) - 2 a^2 = a, trace = -(3a + 1): slow = 2 det / (trace - sqrt(trace^2 - 4 det)).
      const long double trace = -(3.0L * a + 1), det = a, root = std::sqrt(trace * trace - 4 * det);
      const long double slow = 2 * det / (trace - root), fast = (trace - root) / 2;
      const long double decay = std::exp(slow * (long double)h), span = slow - fast;
      const MatrixPhi phi = precise_phi(A, h);
      for (Index i = 0; i < 2; ++i)
        for (Index j = 0; j < 2; ++j) {
          const long double expected = decay * ((long double)A(i, j) - (i == j ? fast : 0)) / span;
          // e^{fast h} < e^{-1000}; the entries of A - fast I cancel to a third, in 64 bits.
          EXPECT_NEAR(phi.exponential(i, j), double(expected), 4 * epsilon) << a << ' ' << h;
          // phi_1 = (e^{hA} - I)(hA)^{-1}: of the slow mode, and 1/|h fast| of the fast one.
          const long double slow_part = std::expm1(slow * (long double)h) / (slow * (long double)h);
          const long double projector = ((long double)A(i, j) - (i == j ? fast : 0)) / span;
          const long double rest = ((i == j ? 1 : 0) - projector) * (-1 / (fast * (long double)h));
          EXPECT_NEAR(phi.phi1(i, j), double(slow_part * projector + rest), 8 * epsilon) << a << ' ' << h;
        }
    }
}

TEST(PrecisePhi, AddsAndDoublesLikeAnExponential) {
  std::mt19937 random(2);
  for (const Index m : {2, 4, 7}) {
    const Matrix A = random_matrix(random, m);
    const MatrixPhi half = precise_phi(A, 0.5), whole = precise_phi(A, 1);
    const double size = half.exponential.norm() * half.exponential.norm();
    EXPECT_LE((half.exponential * half.exponential - whole.exponential).norm(), 10 * double(m) * epsilon * size);
    EXPECT_LE((Matrix::Identity(m, m) + A * whole.phi1 - whole.exponential).norm(),
              10 * double(m) * epsilon * (1 + A.norm() * whole.phi1.norm()));
  }
  EXPECT_EQ(precise_phi(Matrix(0, 0), 1).exponential.size(), 0);
}

TEST(PrecisePhi, IsTakenOnlyWhereRoundingAddsUp) {
  EXPECT_FALSE(needs_precision(Matrix{{-1e4}}, 1e-3, 1000));
  EXPECT_TRUE(needs_precision(Matrix{{-1e10, 1e10}, {2e10, -2e10}}, 1e-3, 1000));
  // Units do not matter: [[-1, 1e10], [1e-10, -1]] is [[-1, 1], [1, -1]] after balancing.
  EXPECT_FALSE(needs_precision(Matrix{{-1, 1e10}, {1e-10, -1}}, 1e-3, 1000));
  EXPECT_FALSE(needs_precision(Matrix::Constant(200, 200, 1e10), 1e-3, 1000)) << "too large for it";
}

}  // namespace
}  // namespace bromwich

// The banded complementarity solver against the dense one.

#include "core/lcp/active_set.hpp"
#include "core/lcp/banded_lcp.hpp"
#include "core/lcp/solution.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

using reference::Random;
using simd::BandedLcp;

/// tridiag(-1, 4, -1) minus a part that decays like a heat kernel of width `reach`, as in M + W_0; not symmetric. Row
/// sums of the subtracted part are 1: strictly diagonally dominant.
Matrix decaying(Index n, double reach, double unit) {
  Matrix M(n, n);
  double sum = 0;
  for (Index d = -n; d <= n; ++d) sum += std::exp(-double(d * d) / (reach * reach));
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j < n; ++j)
      M(i, j) = (i == j                 ? 4
                 : std::abs(i - j) == 1 ? (i < j ? -1 : -0.8)
                                        : 0) -
                std::exp(-double((i - j) * (i - j)) / (reach * reach)) / sum;
  return unit * M;
}

// The inverse is at most 1 in units of M: both solvers are within n eps times the largest q of the solution.
TEST(BandedLcp, AgreesWithTheDenseSolver) {
  for (const auto& [n, reach, unit] : {std::tuple<Index, double, double>{12, 1, 1},
                                       {39, 2, 1},
                                       {127, 3, 1e-6},
                                       {128, 3, 1},
                                       {160, 0.5, 1e5},
                                       {300, 2, 1}}) {
    const Matrix M = decaying(n, reach, unit);
    const auto banded = BandedLcp::make(M);
    ASSERT_TRUE(banded) << n;
    ActiveSetLcp dense(M, LcpClass::P);
    Random random{std::uint32_t(n)};
    Vector q = unit * random.vector(n), y = Vector::Zero(n), expected = y;
    for (int problem = 0; problem < 30; ++problem) {
      // Slow drift, sudden jumps, and the same problem again.
      if (problem % 5 == 0) q = unit * random.vector(n);
      if (problem % 5 < 4) q += 0.05 * unit * random.vector(n);
      if (problem == 17) banded->start_from(random.vector(n));
      int newton = 0;
      ASSERT_TRUE(banded->solve(q, y, newton)) << n << ", problem " << problem;
      ASSERT_TRUE(dense.solve(q, expected).solved);
      EXPECT_GE(newton, 1);
      EXPECT_LE((y - expected).cwiseAbs().maxCoeff(), double(n) * epsilon) << n << ", problem " << problem;
      EXPECT_TRUE(is_solution(M / unit, q / unit, y)) << n << ", problem " << problem;
      const Eigen::Map<const Vector> product(banded->product(), n);
      EXPECT_LE((product - M * y).cwiseAbs().maxCoeff(), 6 * unit * double(n) * epsilon);
    }
  }
}

// Columns that vanish near the diagonal but not farther out, as for two groups of constraints.
TEST(BandedLcp, SeesEntriesBehindAGap) {
  const Index n = 64, gap = 16;
  Matrix M = Matrix::Identity(n, n);
  for (Index i = 0; i + gap < n; ++i) M(i, i + gap) = M(i + gap, i) = 0.4;
  const auto banded = BandedLcp::make(M);
  ASSERT_TRUE(banded);
  Random random{7};
  for (int problem = 0; problem < 20; ++problem) {
    const Vector q = random.vector(n);
    Vector y = Vector::Zero(n);
    int newton = 0;
    ASSERT_TRUE(banded->solve(q, y, newton)) << problem;
    EXPECT_TRUE(is_solution(M, q, y)) << problem;
  }
}

TEST(BandedLcp, LeavesToOthersWhatIsNotABand) {
  Random random(3);
  EXPECT_FALSE(BandedLcp::make(Matrix::Identity(11, 11)));                                   // small
  EXPECT_FALSE(BandedLcp::make(random.dominant(200) + Matrix(Matrix::Identity(200, 200))));  // full
  Matrix M = decaying(40, 1, 1);
  M.row(7) *= 1e3;
  EXPECT_FALSE(BandedLcp::make(M));  // rows of different size
  M = decaying(40, 1, 1);
  M(3, 3) = -1;
  EXPECT_FALSE(BandedLcp::make(M));  // not P
  // A band matrix whose inverse does not decay: the plain second difference.
  const Index n = 400;
  M = 2 * Matrix::Identity(n, n);
  M.diagonal(1).setConstant(-1);
  M.diagonal(-1).setConstant(-1);
  EXPECT_FALSE(BandedLcp::make(M));
}

TEST(BandedLcp, RefusesWhatIsNotFiniteAndGoesOn) {
  const Index n = 30;
  const Matrix M = decaying(n, 2, 1);
  const auto banded = BandedLcp::make(M);
  ASSERT_TRUE(banded);
  Random random(5);
  Vector q = random.vector(n), y = Vector::Constant(n, 7);
  const Vector before = y;
  int newton = 0;
  q[4] = NAN;
  EXPECT_FALSE(banded->solve(q, y, newton));
  EXPECT_EQ(y, before);
  q[4] = 1;
  EXPECT_TRUE(banded->solve(q, y, newton));
  EXPECT_TRUE(is_solution(M, q, y));
  // Finite, but overflows in the units of M.
  const Vector huge = Vector::Constant(n, 1e305), kept = y;
  EXPECT_FALSE(BandedLcp::make(decaying(n, 2, 1e-8))->solve(huge, y, newton));
  EXPECT_EQ(y, kept);
}

}  // namespace
}  // namespace bromwich

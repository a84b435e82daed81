// Two-point problems in many steps and in any units, against states that are known.

#include "core/numerics/two_point.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <unsupported/Eigen/MatrixFunctions>

#include <cmath>

namespace bromwich {
namespace {

/// x' = A x - A s with rates from 0.1 to 1e3: s is the only state with x(0) = x(T), T = 1.
struct Rest {
  Matrix A;
  Vector s;

  explicit Rest(unsigned seed) {
    const Index m = 5;
    reference::Random random(seed);
    const Matrix S = random.matrix(m, m) + 3 * Matrix::Identity(m, m);
    A = S * Vector{{-0.1, -1, -7, -90, -900}}.asDiagonal() * S.inverse();
    s = random.matrix(m, 1).array() + 2;
  }
  Matrix step(Index N) const { return Matrix(A / double(N)).exp(); }
};

/// Rounding of e^{hA} in N steps, over the condition of I - e^{A}, below 1e3.
double accuracy(Index N) { return 1e3 * epsilon * std::sqrt(double(N)) * 100; }

TEST(TwoPoint, PeriodicStatesInAnyUnits) {
  for (const Index N : {100, 8000, 20000})
    for (unsigned seed = 0; seed < 4; ++seed) {
      const Rest rest(seed);
      const Index m = rest.s.size();
      Vector units(m);
      for (Index i = 0; i < m; ++i) units[i] = std::pow(10, double((7 * i + 3 * seed) % 19) - 9);
      const Matrix P = units.cwiseInverse().asDiagonal() * rest.step(N) * units.asDiagonal();
      const Vector known = rest.s.cwiseQuotient(units), p = known - P * known;
      const BoundaryCondition periodic{Matrix::Identity(m, m), -Matrix::Identity(m, m), Vector::Zero(m)};
      const RowMatrix x = solve_two_point(std::vector<const Matrix*>(std::size_t(N), &P), p.transpose().replicate(N, 1),
                                          periodic, epsilon);
      ASSERT_EQ(x.rows(), N + 1) << N;
      for (const Index k : {Index(0), N / 3, N})
        for (Index i = 0; i < m; ++i) EXPECT_NEAR(x(k, i) / known[i], 1, accuracy(N)) << N << " " << seed << " " << i;
    }
}

// Rows that were only scaled had a condition of 1e15 after 8000 steps of states in other units.
TEST(TwoPoint, SegmentsKeepTheirRowsApart) {
  const Index N = 20000;
  const Rest rest(7);
  const Index m = rest.s.size();
  const Vector units{{1, 1e3, 1, 1e-3, 1}};
  const Matrix P = units.cwiseInverse().asDiagonal() * rest.step(N) * units.asDiagonal();
  Segment all = step_segment(P, Vector::Zero(m));
  for (Index k = 1; k < N; ++k) all = joined(all, step_segment(P, Vector::Zero(m)));
  Matrix rows(m, 2 * m);
  rows << all.V, all.U;
  EXPECT_LE((rows * rows.transpose() - Matrix::Identity(m, m)).cwiseAbs().maxCoeff(), 1e-13);
  const Matrix over_all = -all.U.partialPivLu().solve(all.V), expected = Matrix(P.pow(double(N)));
  EXPECT_LE((units.asDiagonal() * (over_all - expected) * units.cwiseInverse().asDiagonal()).cwiseAbs().maxCoeff(),
            1e6 * accuracy(N));  // without the units of their own that solve_two_point takes
}

}  // namespace
}  // namespace bromwich

// Matrices of unknown class and of any scale, Lemke's method, and the enumeration of active sets.

#include "core/lcp/active_set.hpp"
#include "core/lcp/enumeration.hpp"
#include "core/lcp/lemke.hpp"
#include "tests/support/lcp_oracle.hpp"
#include "tests/support/oracle.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include <bit>

namespace bromwich {
namespace {

using reference::Random;

/// ||min(y, w)||_inf relative to the terms of w.
double residual(const Matrix& M, const Vector& q, const Vector& y) {
  const double terms = (M.cwiseAbs() * y + q.cwiseAbs()).maxCoeff();
  return y.cwiseMin(M * y + q).cwiseAbs().maxCoeff() / terms;
}

TEST(LcpUnknown, MissesNoSolution) {
  Random random(31);
  int without = 0, known = 0;
  for (int instance = 0; instance < 4000; ++instance) {
    const Index n = 1 + instance % 8;
    const Matrix M = random.matrix(n, n);
    const Vector q = random.vector(n);
    const auto exact = oracle::solve_lcp(M, q, LcpClass::unknown);
    ActiveSetLcp solver(M, LcpClass::unknown);
    Vector y;
    const LcpOutcome outcome = solver.solve(q, y);
    EXPECT_EQ(outcome.solved, exact.has_value()) << instance << "\n" << M << "\n" << q.transpose();
    EXPECT_EQ(outcome.exhausted, !exact.has_value()) << instance;
    EXPECT_FALSE(outcome.infeasible) << "nothing is proven by that";
    without += !exact;
    if (!outcome.solved) continue;
    // Backward stable solves of size n <= 8, after scaling.
    EXPECT_LE(residual(M, q, y), 1e-12) << instance;
    known += (y - *exact).cwiseAbs().maxCoeff() > 1e-6;
  }
  EXPECT_GT(without, 500);
  EXPECT_GT(known, 100) << "several solutions are common: any of them will do";
}

// Whether some y >= 0 has M y + q >= 0: then a basic solution of M y - w = -q has y, w >= 0.
bool has_feasible_point(const Matrix& M, const Vector& q) {
  const Index n = q.size();
  Matrix all(n, 2 * n);
  all << M, -Matrix::Identity(n, n);
  for (unsigned set = 0; set < 1u << 2 * n; ++set) {
    if (std::popcount(set) != n) continue;
    Matrix basis(n, n);
    Index column = 0;
    for (Index i = 0; i < 2 * n; ++i)
      if (set >> i & 1u) basis.col(column++) = all.col(i);
    const Eigen::FullPivLU<Matrix> lu(basis);
    if (lu.isInvertible() && (lu.solve(-q).array() >= -1e-12).all()) return true;
  }
  return false;
}

TEST(LcpUnknown, FeasiblePointsAreFound) {
  Random random(35);
  int with = 0, without = 0;
  for (int instance = 0; instance < 1500; ++instance) {
    const Index n = 1 + instance % 4;
    const Matrix M = random.matrix(n, n);
    const Vector q = random.vector(n);
    const bool has_point = has_feasible_point(M, q);
    EXPECT_EQ(has_no_feasible_point(M, q), !has_point) << instance << "\n" << M << "\n" << q.transpose();
    (has_point ? with : without)++;
  }
  EXPECT_GT(with, 500);
  EXPECT_GT(without, 50);
}

TEST(LcpUnknown, SingularActiveSets) {
  // The only solutions are (t, 0), t >= 1, and M_SS is singular for every S but the empty one.
  const Matrix M{{0, 0}, {1, 0}};
  ActiveSetLcp solver(M, LcpClass::unknown);
  Vector y;
  ASSERT_TRUE(solver.solve(Vector{{0, -1}}, y).solved);
  EXPECT_LE(residual(M, Vector{{0, -1}}, y), 1e-15);
  EXPECT_TRUE(solver.solve(Vector{{-1, 0}}, y).exhausted);
  Random random(32);
  for (int instance = 0; instance < 500; ++instance) {
    const oracle::Monotone p = oracle::random_monotone(random, 1 + instance % 6, instance % 4);
    ASSERT_TRUE(ActiveSetLcp(-p.M, LcpClass::unknown).solve(p.q + 2 * p.M * p.known, y).solved) << instance;
  }
}

TEST(LcpUnknown, NearlySingularIsNoSolution) {
  // -y_0 + y_1 = 1 = y_0 - y_1 up to 1e-15: rounding of a solution y would exceed q.
  const Matrix M{{-1, 1}, {1 + 2 * epsilon, -1}};
  Vector y;
  const LcpOutcome outcome = ActiveSetLcp(M, LcpClass::unknown).solve(Vector{{-1, -1}}, y);
  EXPECT_FALSE(outcome.solved);
}

TEST(LcpAnyScale, RowsAndColumns) {
  Random random(33);
  const auto wild = [&random](Index n) {
    return Vector(Vector::NullaryExpr(n, [&random] { return std::exp2(std::round(random.uniform(-40, 40))); }));
  };
  for (int instance = 0; instance < 3000; ++instance) {
    const Index n = 1 + instance % 8;
    const LcpClass c = instance % 3 == 0 ? LcpClass::P : instance % 3 == 1 ? LcpClass::Z : LcpClass::unknown;
    Matrix M = random.dominant(n);
    if (c == LcpClass::Z)
      M = (M - Matrix(M.diagonal().asDiagonal())).cwiseAbs() * -1.3 + Matrix(M.diagonal().asDiagonal());
    const Vector q = random.vector(n), rows = wild(n), columns = wild(n);
    const double size = std::pow(10, random.uniform(-12, 12));
    const auto exact = oracle::solve_lcp(M, q, c);
    ActiveSetLcp solver(rows.asDiagonal() * M * columns.asDiagonal(), c);
    Vector y;
    const LcpOutcome outcome = solver.solve(size * rows.cwiseProduct(q), y);
    ASSERT_EQ(outcome.solved, exact.has_value()) << instance;
    EXPECT_EQ(outcome.infeasible, c == LcpClass::Z && !exact) << instance;
    if (!exact) continue;
    const Vector back = y.cwiseProduct(columns) / size;
    // Powers of two scale without rounding; the condition of M_SS is below 1e4 except for Z near infeasibility.
    EXPECT_LE((back - *exact).cwiseAbs().maxCoeff(), 1e-8 * (1 + exact->cwiseAbs().maxCoeff())) << instance;
  }
}

TEST(LcpAnyScale, CircuitAndStepTogether) {
  // A resistance of 1e3, a conductance of 1e-3, and a constraint coupled only by the step size, with 1e-20.
  const Matrix M{{1e3, 1, 0}, {-1, 1e-3, 0}, {0, 0, 1e-20}};
  ASSERT_EQ(classify(M), LcpClass::P);
  const Vector solution{{1e-3, 0, 7}};
  const Vector q = Vector{{0, 2, 0}} - M * solution;
  Vector y;
  ASSERT_TRUE(ActiveSetLcp(M, LcpClass::P).solve(q, y).solved);
  EXPECT_LE((y - solution).cwiseQuotient(Vector{{1e-3, 1, 7}}).cwiseAbs().maxCoeff(), 1e-14);
}

TEST(Lemke, SolvesP) {
  Random random(34);
  for (int instance = 0; instance < 1000; ++instance) {
    const Index n = 1 + instance % 8;
    const Matrix M = random.dominant(n);
    const Vector q = random.vector(n);
    const LemkeOutcome outcome = lemke(M, q);
    ASSERT_TRUE(outcome.solved) << instance;
    EXPECT_LE((outcome.y - *oracle::solve_lcp(M, q, LcpClass::P)).cwiseAbs().maxCoeff(), 1e-10) << instance;
  }
  // Every ratio ties: q = -1 and equal rows.
  const Matrix M = Matrix::Identity(9, 9) + Matrix::Ones(9, 9);
  const LemkeOutcome outcome = lemke(M, -Vector::Ones(9));
  ASSERT_TRUE(outcome.solved);
  EXPECT_LE((outcome.y - Vector::Constant(9, 0.1)).cwiseAbs().maxCoeff(), 1e-15);
}

// Planar contacts with friction, y = (normal force, friction + mu times that, slack of sliding) of each, any mu and
// rows of sizes that differ by 1e8: with independent contacts, a larger diagonal and gaps that open faster than
// contacts slide no ray is met.
TEST(Lemke, SolvesContactsWithFriction) {
  constexpr double raised = 1e-9, sliding = 1.0 / 64;
  Random random(38);
  for (int instance = 0; instance < 300; ++instance) {
    const Index k = 1 + instance % 12, n = 3 * k;
    const Matrix H = random.matrix(2 * k, 2 * k), W = H * H.transpose() + 1e-3 * Matrix::Identity(2 * k, 2 * k);
    const Vector mu = 2 * random.vector(k).cwiseAbs(), free = random.vector(2 * k);
    Matrix M = Matrix::Zero(n, n);
    Vector q = Vector::Zero(n), cover = Vector::Constant(n, sliding);
    for (Index i = 0; i < k; ++i) {
      for (Index j = 0; j < k; ++j)
        for (Index a = 0; a < 2; ++a) {
          M(3 * i + a, 3 * j) = W(2 * i + a, 2 * j) - mu[j] * W(2 * i + a, 2 * j + 1);
          M(3 * i + a, 3 * j + 1) = W(2 * i + a, 2 * j + 1);
        }
      M(3 * i + 1, 3 * i + 2) = 1;
      M(3 * i + 2, 3 * i) = 2 * mu[i], M(3 * i + 2, 3 * i + 1) = -1, M(3 * i + 2, 3 * i + 2) = raised;
      q.segment(3 * i, 2) = (instance % 3 == 0 && i % 2 == 0 ? 1e8 : 1.0) * free.segment(2 * i, 2);
      if (i % 2 == 0) q[3 * i] = std::abs(q[3 * i]);
      cover[3 * i] = 1;
    }
    const LemkeOutcome outcome = lemke(M, q, cover);
    ASSERT_TRUE(outcome.solved) << instance;
    EXPECT_LE(residual(M, q, outcome.y), 1e-9) << instance;
  }
}

TEST(Lemke, RayProvesNothingWithoutCopositivity) {
  Random random(35);
  int rays = 0;
  for (int instance = 0; instance < 4000; ++instance) {
    const Index n = 2 + instance % 3;
    const Matrix M = random.matrix(n, n);
    const Vector q = random.vector(n);
    if (!lemke(M, q).ray || !oracle::solve_lcp(M, q, LcpClass::unknown)) continue;
    ++rays;
    Vector y;
    const LcpOutcome outcome = ActiveSetLcp(M, LcpClass::unknown).solve(q, y);
    EXPECT_TRUE(outcome.solved) << instance;
    EXPECT_FALSE(outcome.infeasible);
  }
  EXPECT_GT(rays, 20) << "solvable problems on which Lemke ends on a ray";
}

TEST(Lemke, RayProvesInfeasibilityForPSD) {
  Random random(36);
  for (int instance = 0; instance < 200; ++instance) {
    const oracle::Monotone p = oracle::random_monotone(random, 1 + instance % 5, instance % 4);
    EXPECT_FALSE(lemke(p.M, p.q).ray) << instance << "\n" << p.M << "\n" << p.q.transpose();
    EXPECT_FALSE(lemke(p.M, p.q - p.M * Vector::Ones(p.q.size())).ray) << instance << ": still feasible";
  }
}

TEST(Enumeration, NonnegativeLeastSquares) {
  Random random(37);
  for (int instance = 0; instance < 300; ++instance) {
    const Index rows = 1 + instance % 6, columns = 1 + instance % 5;
    Matrix A = random.matrix(rows, columns);
    if (instance % 3 == 0) A.col(columns - 1) = A.col(0);
    const Vector b = random.vector(rows), x = nonnegative_least_squares(A, b);
    // Optimal exactly if x >= 0, the gradient A^T (A x - b) >= 0, and one of the two vanishes in each component.
    const Vector gradient = A.transpose() * (A * x - b);
    EXPECT_LE(x.cwiseMin(gradient).cwiseAbs().maxCoeff(), 1e-12 * (1 + x.maxCoeff())) << instance;
  }
}

// A step of the twisting controller, x1' = x2, x2' = -2 sgn x1 - sgn x2, by Radau IIA: skew up to terms of size h and
// h^2, of unknown class. Newton's method from the empty set ends at a singular set. The solution that Lemke's method
// then finds is the start for the next problem, even if the two sets differ in few indices.
TEST(LcpUnknown, TwistingStaysOnItsActiveSet) {
  for (const double h : {1. / 2000, 1. / 3200, 1. / 3802}) {
    const Matrix A{{0, 1}, {0, 0}}, relays{{0, 0}, {2, 1}}, a{{5. / 12, -1. / 12}, {3. / 4, 1. / 4}};
    Matrix system = Matrix::Identity(4, 4), right = Matrix::Zero(4, 4), see = Matrix::Zero(8, 4),
           M = Matrix::Zero(8, 8);
    for (Index i = 0; i < 2; ++i) {
      for (Index j = 0; j < 2; ++j) {
        system.block(2 * i, 2 * j, 2, 2) -= h * a(i, j) * A;
        right.block(2 * i, 2 * j, 2, 2) = h * a(i, j) * relays;
      }
      see.block(4 * i, 2 * i, 2, 2) = -Matrix::Identity(2, 2);
      M.block(4 * i, 4 * i + 2, 2, 2).setIdentity();
      M.block(4 * i + 2, 4 * i, 2, 2) = -Matrix::Identity(2, 2);
    }
    const Matrix response = system.inverse() * right,
                 start = system.inverse().leftCols(2) + system.inverse().rightCols(2);
    for (Index i = 0; i < 2; ++i) M.middleCols(4 * i, 2) += see * response.middleCols(2 * i, 2) * -2;
    ActiveSetLcp solver(M, classify(LcpMatrix(M)));
    Vector x{{1, 1}}, y;
    int fallbacks = 0;
    for (int step = 1; double(step) * h < 0.25; ++step) {
      const Vector free = start * x + response * Vector::Ones(4);
      Vector q = see * free;
      for (const Index i : {2, 3, 6, 7}) q[i] = 1;
      const LcpOutcome outcome = solver.solve(q, y);
      ASSERT_TRUE(outcome.solved) << h << ' ' << step;
      fallbacks += outcome.fallback;
      const Vector after = free - 2 * response * y(std::vector<Index>{0, 1, 4, 5});
      x = after.tail(2);
      const double t = double(step) * h;  // both relays are on: x2' = -3
      ASSERT_NEAR(x[1], 1 - 3 * t, 1e-12) << h << ' ' << step;
    }
    EXPECT_LE(fallbacks, 2) << h;
  }
}

}  // namespace
}  // namespace bromwich

// The active-set solver for P- and Z-matrices against enumeration of all active sets.

#include "core/lcp/active_set.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>
#include <Eigen/Dense>

namespace bromwich {
namespace {

using reference::cycling;
using reference::fold;
using reference::Random;
using reference::tridiagonal;

Matrix random_P(Random& random, Index n, int kind) {
  if (kind % 2 == 0) return random.dominant(n);
  const Matrix L = random.matrix(n, n), skew = random.matrix(n, n);
  return L * L.transpose() + 0.3 * Matrix::Identity(n, n) + skew - skew.transpose();
}

/// Two solutions by different factorizations: condition numbers of a few hundred, times eps and the size of y.
double close(const Vector& y) { return 1e-11 * (1 + y.cwiseAbs().maxCoeff()); }

void expect_complementary(const ActiveSetLcp& solver, const Matrix& M, const Vector& q, const Vector& y) {
  const double scale = 1 + q.cwiseAbs().maxCoeff() + M.cwiseAbs().maxCoeff() * y.cwiseAbs().sum();
  EXPECT_GE(y.minCoeff(), 0);
  // Rounding of M y + q in n <= 100 terms, and of the transform kept from call to call.
  EXPECT_LE((M * y + q - solver.slack()).cwiseAbs().maxCoeff(), 1e-12 * scale);
  EXPECT_LE(y.cwiseMin(solver.slack()).cwiseAbs().maxCoeff(), 1e-12 * scale);
}

TEST(ActiveSetLcp, PAgainstEnumeration) {
  Random random(3);
  for (Index n = 1; n <= 8; ++n)
    for (int instance = 0; instance < 300; ++instance) {
      const Matrix M = random_P(random, n, instance);
      const Vector q = random.vector(n);
      const auto exact = oracle::solve_lcp(M, q, LcpClass::P);
      ASSERT_TRUE(exact);
      ActiveSetLcp solver(M, LcpClass::P);
      Vector y;
      const LcpOutcome outcome = solver.solve(q, y);
      ASSERT_TRUE(outcome.solved) << "n = " << n << ", instance " << instance;
      EXPECT_LE((y - *exact).cwiseAbs().maxCoeff(), close(*exact)) << "n = " << n << ", instance " << instance;
      EXPECT_FALSE(outcome.infeasible);
      expect_complementary(solver, M, q, y);
    }
}

TEST(ActiveSetLcp, LeastElementsAgainstEnumeration) {
  Random random(4);
  int infeasible = 0;
  for (Index n = 1; n <= 8; ++n)
    for (int instance = 0; instance < 300; ++instance) {
      Matrix M = -random.matrix(n, n).cwiseAbs();
      for (Index i = 0; i < n; ++i) M(i, i) = random.uniform(-0.3, 0.7 * double(n));
      const Vector q = random.vector(n);
      const auto exact = oracle::solve_lcp(M, q, LcpClass::Z);
      ActiveSetLcp solver(M, LcpClass::Z);
      Vector y;
      const LcpOutcome outcome = solver.solve(q, y);
      ASSERT_EQ(outcome.solved, exact.has_value()) << "n = " << n << ", instance " << instance;
      EXPECT_EQ(outcome.infeasible, !exact.has_value()) << "n = " << n << ", instance " << instance;
      infeasible += outcome.infeasible;
      // M_SS may be close to singular: up to four more digits than for P are lost, in proportion to y.
      if (!exact) continue;
      EXPECT_LE((y - *exact).cwiseAbs().maxCoeff(), 1e4 * close(*exact)) << n << ' ' << instance;
    }
  EXPECT_GT(infeasible, 200);
  EXPECT_LT(infeasible, 2200);
}

/// Pure semismooth Newton on min(y, w), from one active set to the next until a set repeats. True if that is not the
/// same set twice in a row (a cycle).
bool newton_cycles(const Matrix& M, const Vector& q, unsigned set) {
  std::vector<char> seen(std::size_t(1) << q.size(), 0);
  while (!seen[set]) {
    seen[set] = 1;
    Matrix system = Matrix::Identity(q.size(), q.size());  // rows of M on the set, y_i = 0 elsewhere
    Vector right = Vector::Zero(q.size());
    for (Index i = 0; i < q.size(); ++i)
      if (set >> i & 1u) system.row(i) = M.row(i), right[i] = -q[i];
    const Vector y = system.partialPivLu().solve(right), w = M * y + q;
    unsigned next = 0;
    for (Index i = 0; i < q.size(); ++i) next |= unsigned(y[i] > w[i]) << i;
    if (next == set) return false;
    set = next;
  }
  return true;
}

TEST(ActiveSetLcp, EndsWhereNewtonCycles) {
  int cycles = 0;
  for (unsigned start = 0; start < 8; ++start) cycles += newton_cycles(cycling, Vector::Constant(3, -1), start);
  EXPECT_EQ(cycles, 6);
  int fallbacks = 0;
  for (unsigned start = 0; start < 8; ++start) {
    ActiveSetLcp solver(cycling, LcpClass::P);
    // y = 1 on the set, w = 1 elsewhere: the only solution of its problem.
    Vector y(3), w(3);
    for (Index i = 0; i < 3; ++i) {
      y[i] = start >> i & 1u;
      w[i] = 1 - y[i];
    }
    Vector found;
    ASSERT_TRUE(solver.solve(w - cycling * y, found).solved);
    ASSERT_LE((found - y).cwiseAbs().maxCoeff(), 1e-14);
    const LcpOutcome outcome = solver.solve(Vector::Constant(3, -1), found);
    EXPECT_TRUE(outcome.solved) << "from set " << start;
    EXPECT_LE((found - Vector::Constant(3, 1. / 3)).cwiseAbs().maxCoeff(), 1e-14) << "from set " << start;
    fallbacks += outcome.fallback;
  }
  EXPECT_GT(fallbacks, 0) << "some starts cycle";
}

TEST(ActiveSetLcp, WarmStartsOverSequences) {
  Random random(5);
  for (int kind = 0; kind < 6; ++kind) {
    const Index n = 2 + kind;
    const bool least = kind >= 4;
    Matrix M = random_P(random, n, kind);
    if (least) {
      M = -random.matrix(n, n).cwiseAbs();
      M.diagonal().setConstant(0.5 * double(n));
    }
    const Vector a = 0.3 * random.vector(n), b = random.vector(n), phase = 3 * random.vector(n);
    ActiveSetLcp solver(M, least ? LcpClass::Z : LcpClass::P);
    Vector y;
    for (int j = 0; j < 200; ++j) {
      const Vector q = a.array() + b.array() * (0.1 * j + phase.array()).sin() + (least ? 0.3 : 0.0);
      const auto exact = oracle::solve_lcp(M, q, least ? LcpClass::Z : LcpClass::P);
      const LcpOutcome outcome = solver.solve(q, y);
      ASSERT_EQ(outcome.solved, exact.has_value()) << "kind " << kind << ", step " << j;
      if (!exact) continue;
      // The transform is kept over many steps: its updates cost a digit or two.
      EXPECT_LE((y - *exact).cwiseAbs().maxCoeff(), 1e2 * close(*exact)) << "kind " << kind << ", step " << j;
    }
    EXPECT_TRUE(solver.solve(Vector::Ones(n), y).solved);
    EXPECT_EQ(y.cwiseAbs().maxCoeff(), 0);
  }
}

// Newton's method passes through nearly singular sets; what their transforms lose, later ones do not inherit.
TEST(ActiveSetLcp, NearlySingularSetsCostNoDigitsLater) {
  Random random(17);
  for (int instance = 0; instance < 200; ++instance) {
    const Index n = 2 + instance % 5;
    const Matrix skew = random.matrix(n, n);
    const Matrix M = skew - skew.transpose() + std::pow(10.0, -1 - instance % 7) * Matrix::Identity(n, n);
    ActiveSetLcp solver(M, LcpClass::P);
    for (int call = 0; call < 40; ++call) {
      const Vector q = random.vector(n);
      Vector y;
      ASSERT_TRUE(solver.solve(q, y).solved) << instance << ' ' << call;
      // Transforms with entries up to 100 are not refined: three exchanges of one lose eps 100^3 at most.
      const Vector terms = M.cwiseAbs() * y + q.cwiseAbs();
      EXPECT_LE(y.cwiseMin(M * y + q).cwiseAbs().maxCoeff(), 1e6 * epsilon * terms.maxCoeff())
          << instance << ' ' << call;
    }
  }
}

TEST(ActiveSetLcp, LeastOfTwoSolutions) {
  const Vector q{{-1, 3}}, least{{1, 0}}, other{{5. / 3, 1. / 3}};
  ASSERT_LE((fold * other + q).cwiseAbs().maxCoeff(), 1e-15);
  ActiveSetLcp solver(fold, LcpClass::Z);
  solver.start_from(other);
  Vector y;
  ASSERT_TRUE(solver.solve(q, y).solved);
  EXPECT_LE((y - least).cwiseAbs().maxCoeff(), 1e-15);

  // The block of the other solution's active set is not an M-matrix; with a reference matrix this is detected for any
  // class.
  ActiveSetLcp judged(fold, LcpClass::unknown, &fold);
  judged.start_from(other);
  ASSERT_TRUE(judged.solve(q, y).solved);
  EXPECT_LE((y - least).cwiseAbs().maxCoeff(), 1e-15);

  const LcpOutcome none = solver.solve(Vector{{-1, 1.9}}, y);
  EXPECT_FALSE(none.solved);
  EXPECT_TRUE(none.infeasible);
}

TEST(ActiveSetLcp, LargeProblemAgainstProjectedGaussSeidel) {
  const Index n = 100;
  const Matrix M = to_dense(LcpMatrix(tridiagonal(n, -1.5, 4, -0.5)));
  ActiveSetLcp solver(M, LcpClass::P);
  Random random(6);
  Vector y;
  for (int instance = 0; instance < 20; ++instance) {
    const Vector q = random.vector(n);
    Vector z = Vector::Zero(n);
    for (int sweep = 0; sweep < 100; ++sweep)  // contracts by 1/2 per sweep
      for (Index i = 0; i < n; ++i) z[i] = std::max(0.0, z[i] - (M.row(i).dot(z) + q[i]) / M(i, i));
    ASSERT_TRUE(solver.solve(q, y).solved) << instance;
    EXPECT_LE((y - z).cwiseAbs().maxCoeff(), 1e-14) << instance;  // ||M^{-1}|| <= 1/2, values below 1
    expect_complementary(solver, M, q, y);
  }
}

TEST(ActiveSetLcp, ReportsWhatIsNotFinite) {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()})
    for (const LcpClass c : {LcpClass::P, LcpClass::Z}) {
      ActiveSetLcp solver(Matrix::Identity(3, 3), c);
      Vector y = Vector::Zero(3), q{{1, bad, -1}};
      const LcpOutcome outcome = solver.solve(q, y);
      EXPECT_FALSE(outcome.solved);
      EXPECT_FALSE(outcome.infeasible) << "nothing is proven";
      EXPECT_TRUE(solver.solve(Vector{{1, 2, -1}}, y).solved) << "and it recovers";
      EXPECT_EQ(y[2], 1);
    }
}

}  // namespace
}  // namespace bromwich

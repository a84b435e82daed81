// Positive semidefinite problems: the least-norm solution against enumeration of the active inequalities, and
// infeasibility of problems that are infeasible by construction.

#include "core/lcp/active_set.hpp"
#include "tests/support/lcp_oracle.hpp"

#include <gtest/gtest.h>

namespace bromwich {
namespace {

using reference::Random;

/// In both solvers least-norm solutions have the error eps times the condition of the active set (up to 1e4 here).
constexpr double close_enough = 1e-9;

TEST(LcpPSD, LeastNormAgainstEnumeration) {
  Random random(21);
  int degenerate = 0;
  for (int instance = 0; instance < 2000; ++instance) {
    const Index n = 1 + instance % 4;
    const oracle::Monotone p = oracle::random_monotone(random, n, instance / 4 % 4);
    const Vector exact = oracle::least_norm(p.M, p.q, p.known);
    ActiveSetLcp solver(p.M, LcpClass::PSD);
    Vector y;
    const LcpOutcome outcome = solver.solve(p.q, y);
    ASSERT_TRUE(outcome.solved) << instance << "\n" << p.M << "\n" << p.q.transpose();
    EXPECT_FALSE(outcome.infeasible);
    EXPECT_LE((y - exact).cwiseAbs().maxCoeff(), close_enough)
        << instance << "\n"
        << p.M << "\nq " << p.q.transpose() << "\ny " << y.transpose() << "\nexact " << exact.transpose();
    degenerate += (p.known - exact).cwiseAbs().maxCoeff() > 1e-6;
    // From another solution: the answer must not depend on the start.
    solver.start_from(p.known);
    ASSERT_TRUE(solver.solve(p.q, y).solved) << instance;
    EXPECT_LE((y - exact).cwiseAbs().maxCoeff(), close_enough) << instance;
  }
  EXPECT_GT(degenerate, 300) << "the known solution often is another one";
}

TEST(LcpPSD, LargerLeastNormProblems) {
  Random random(22);
  for (int instance = 0; instance < 24; ++instance) {
    const oracle::Monotone p = oracle::random_monotone(random, 5 + instance % 2, instance / 2 % 4);
    const Vector exact = oracle::least_norm(p.M, p.q, p.known);
    const LeastNorm found = least_norm_solution(p.M, p.q);
    ASSERT_TRUE(found.solved) << instance;
    EXPECT_LE((found.y - exact).cwiseAbs().maxCoeff(), close_enough) << instance << "\n"
                                                                     << p.M << "\nq " << p.q.transpose();
  }
}

TEST(LcpPSD, AnyScale) {
  Random random(23);
  for (int instance = 0; instance < 400; ++instance) {
    const oracle::Monotone p = oracle::random_monotone(random, 1 + instance % 4, instance / 4 % 4);
    const LeastNorm exact = least_norm_solution(p.M, p.q);
    ASSERT_TRUE(exact.solved);
    for (const auto& [m, q] : {std::pair{1e-12, 1.0}, {1e12, 1e-12}, {1e-20, 1e-20}, {1.0, 1e12}}) {
      ActiveSetLcp solver(m * p.M, LcpClass::PSD);
      Vector y;
      ASSERT_TRUE(solver.solve(q * p.q, y).solved) << instance << ' ' << m << ' ' << q;
      EXPECT_LE((m / q * y - exact.y).cwiseAbs().maxCoeff(), close_enough) << instance << ' ' << m << ' ' << q;
    }
  }
}

TEST(LcpPSD, InfeasibleWhereProven) {
  Random random(24);
  int proven = 0;
  for (int instance = 0; instance < 1000; ++instance) {
    const oracle::Monotone p = oracle::random_infeasible(random, 1 + instance % 8);
    Vector y;
    const LcpOutcome outcome = ActiveSetLcp(p.M, LcpClass::PSD).solve(p.q, y);
    EXPECT_FALSE(outcome.solved) << instance << "\n" << p.M << "\n" << p.q.transpose();
    proven += outcome.infeasible;
  }
  EXPECT_EQ(proven, 1000);
}

TEST(LcpPSD, TwoEqualDiodes) {
  for (const double R : {1e3, 1e-3, 1.0}) {
    ActiveSetLcp solver(Matrix{{R, R}, {R, R}}, LcpClass::PSD);
    Vector y;
    ASSERT_TRUE(solver.solve(Vector{{-1, -1}}, y).solved);
    EXPECT_NEAR(y[0], 0.5 / R, 4 * epsilon / R);
    EXPECT_NEAR(y[1], 0.5 / R, 4 * epsilon / R);
    solver.start_from(Vector{{1 / R, 0}});
    ASSERT_TRUE(solver.solve(Vector{{-1, -1}}, y).solved);
    EXPECT_NEAR(y[1], 0.5 / R, 4 * epsilon / R) << "whatever the start";
    ASSERT_TRUE(solver.solve(Vector{{-1, -0.5}}, y).solved);
    EXPECT_NEAR(y[0], 1 / R, 4 * epsilon / R);
    EXPECT_EQ(y[1], 0);
  }
}

TEST(LcpPSD, NoMatrix) {
  ActiveSetLcp solver(Matrix::Zero(2, 2), LcpClass::PSD);
  Vector y;
  EXPECT_TRUE(solver.solve(Vector{{0, 3}}, y).solved);
  EXPECT_EQ(y, Vector::Zero(2));
  const LcpOutcome outcome = solver.solve(Vector{{1, -1}}, y);
  EXPECT_FALSE(outcome.solved);
  EXPECT_TRUE(outcome.infeasible);
}

// What is kept of an active set is used when it comes back, also after more sets (up to 32) than are kept: the answers
// are those of a new solver for each problem.
TEST(LcpPSD, SetsThatComeBack) {
  Random random(24);
  const Index n = 5;
  for (int instance = 0; instance < 20; ++instance) {
    const Matrix M = oracle::random_monotone(random, n, instance % 4).M;
    ActiveSetLcp kept(M, LcpClass::PSD);
    std::vector<Vector> problems;
    for (int k = 0; k < 60; ++k) {
      Vector w = Vector::Zero(n), z = Vector::Zero(n);
      for (Index i = 0; i < n; ++i) (random.uniform(0, 1) < 0.5 ? w : z)[i] = random.uniform(0.1, 1);
      problems.push_back(w - M * z);
    }
    for (int k = 0; k < 120; ++k) {
      const Vector& q = problems[std::size_t(k) % problems.size()];
      Vector y, fresh;
      ASSERT_TRUE(kept.solve(q, y).solved) << instance << ", problem " << k;
      ASSERT_TRUE(ActiveSetLcp(M, LcpClass::PSD).solve(q, fresh).solved) << instance << ", problem " << k;
      EXPECT_LE((y - fresh).cwiseAbs().maxCoeff(), close_enough) << instance << ", problem " << k << "\n" << M;
    }
  }
}

// A kept verdict holds for its own set alone: of two equal rows both sets with one of them are well conditioned, the
// set of both is not, whatever was asked before.
TEST(LcpPSD, ConditionOfASetIsItsOwn) {
  const Matrix M{{1, 1, 0}, {1, 1 + 1e-12, 0}, {0, 0, 1}};
  EXPECT_TRUE(is_well_conditioned(M, {0, 2}));
  EXPECT_TRUE(is_well_conditioned(M, {1, 2}));
  EXPECT_FALSE(is_well_conditioned(M, {0, 1}));
  EXPECT_TRUE(is_well_conditioned(M, {}));
  // Newton's method ends on {0, 1} too, where LU loses twelve digits; the least norm has none to lose. The problems
  // before it have another set of two.
  ActiveSetLcp solver(M, LcpClass::PSD);
  Vector y;
  for (const double size : {0.1, 0.37, 0.7, 0.9}) {
    ASSERT_TRUE(solver.solve(Vector{{-size, 1, -size}}, y).solved) << size;
    EXPECT_LE((y - Vector{{size, 0, size}}).cwiseAbs().maxCoeff(), 1e-15) << size;
    ASSERT_TRUE(solver.solve(Vector(-M * Vector{{size, size, 0}} + Vector{{0, 0, 1}}), y).solved) << size;
    EXPECT_LE((y - Vector{{size, size, 0}}).cwiseAbs().maxCoeff(), close_enough) << size;
  }
}

TEST(LcpPSD, Relays) {
  // y = (s, y+), w = (y-, 1 - s): s = 1 for C x > 0, 0 for C x < 0, and the least norm is s = 0 at C x = 0.
  const Matrix M{{0, 1}, {-1, 0}};
  ActiveSetLcp solver(M, LcpClass::PSD);
  Vector y;
  for (const double Cx : {2.0, -3.0, 0.0, 1e-9, 4.0, 0.0, -1e-9}) {
    ASSERT_TRUE(solver.solve(Vector{{-Cx, 1}}, y).solved) << Cx;
    EXPECT_LE((y - Vector{{Cx > 0 ? 1.0 : 0.0, std::max(Cx, 0.0)}}).cwiseAbs().maxCoeff(), 1e-15) << Cx;
  }
}

TEST(LcpPSD, UniqueForCertain) {
  const Matrix M{{1, 1}, {1, 1}};
  EXPECT_TRUE(is_certainly_unique(M, Vector{{-1, 1}}, Vector{{1, 0}}));
  EXPECT_FALSE(is_certainly_unique(M, Vector{{-1, -1}}, Vector{{1, 0}})) << "w_1 = y_1 = 0";
  EXPECT_FALSE(is_certainly_unique(M, Vector{{-1, -1}}, Vector{{0.5, 0.5}})) << "singular";
  const Tridiagonal t{Vector::Ones(2), Vector::Ones(2), Vector::Ones(2)};
  EXPECT_TRUE(is_certainly_unique(t, Vector{{-1, 1}}, Vector{{1, 0}}));
  EXPECT_FALSE(is_certainly_unique(t, Vector{{-1, -1}}, Vector{{1, 0}}));
  EXPECT_FALSE(is_certainly_unique(t, Vector{{-1, -1}}, Vector{{0.5, 0.5}}));
}

}  // namespace
}  // namespace bromwich

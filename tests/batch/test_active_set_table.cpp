// Active sets of a table against enumeration.

#include "batch/active_set_table.hpp"

#include "batch/short_inverse.hpp"
#include "core/lcp/other_solutions.hpp"
#include "tests/support/oracle.hpp"

#include <gtest/gtest.h>
#include <Eigen/LU>

#include <random>

namespace bromwich::active_set_table_test {
namespace {

Matrix draw(std::mt19937& generator, Index rows, Index cols) {
  std::normal_distribution<double> normal;
  return Matrix::NullaryExpr(rows, cols, [&] { return normal(generator); });
}

// M inverse - I has entries of some n eps times the condition; the condition in the 1-norm is |M|_1 |M^{-1}|_1.
TEST(ShortInverse, IsTheInverse) {
  std::mt19937 generator(8);
  for (Index n = 1; n <= most_short; ++n) {
    const Matrix M = draw(generator, n, n);
    ShortMatrix inverse;
    const double condition = invert(M, inverse);
    const Matrix expected = Eigen::FullPivLU<Matrix>(M).inverse();
    const double exact = 1 / (M.cwiseAbs().colwise().sum().maxCoeff() * expected.cwiseAbs().colwise().sum().maxCoeff());
    EXPECT_NEAR(condition, exact, 1e-12) << n;
    EXPECT_LT((M * inverse - Matrix::Identity(n, n)).cwiseAbs().maxCoeff(), 64 * double(n) * epsilon / exact) << n;
    Matrix singular = M;
    singular.col(n - 1).setZero();
    EXPECT_EQ(invert(singular, inverse), 0) << n;
    singular(0, n - 1) = NAN;
    EXPECT_EQ(invert(singular, inverse), 0) << n;
  }
  Matrix rows(2, 3);
  rows << 1, 2, 3, 4, 5, 6;
  EXPECT_EQ(Matrix(short_block(rows, 2, 5)), (Matrix(1, 2) << 4, 6).finished());
  EXPECT_EQ(short_block(rows, 0, 7).size(), 0);
}

TEST(ActiveSetTable, SolvesProblemsOfClassPFromAnySet) {
  std::mt19937 generator(3);
  for (Index n = 1; n <= 6; ++n) {
    Matrix M = draw(generator, n, n);
    M = (M * M.transpose() + Matrix::Identity(n, n)).eval();
    const ActiveSetTable table(M, nullptr);
    int solved = 0;
    for (unsigned trial = 0; trial < 40; ++trial) {
      const Vector q = draw(generator, n, 1);
      unsigned set = trial % (1u << n);
      double value[8];
      if (!table.solve(q.data(), set, value)) continue;  // Newton may cycle
      ++solved;
      const auto expected = oracle::solve_lcp(M, q, LcpClass::P);
      ASSERT_TRUE(expected);
      for (Index i = 0; i < n; ++i) {
        const double y = (set >> i) & 1u ? table.column_scale(i) * value[i] : 0;
        EXPECT_NEAR(y, (*expected)[i], 1e-12 * (1 + expected->cwiseAbs().maxCoeff()));  // condition below 1e2
      }
    }
    EXPECT_GT(solved, 30) << n;
  }
}

TEST(ActiveSetTable, SetsThatLeadNowhereAreNotUsable) {
  Matrix M(2, 2), least(2, 2);
  M << 0, 1, 1, 0;
  EXPECT_FALSE(ActiveSetTable(M, nullptr).at(1).usable);  // M_11 = 0
  EXPECT_TRUE(ActiveSetTable(M, nullptr).at(3).usable);
  least << -1, 0, 0, 1;
  EXPECT_FALSE(ActiveSetTable(Matrix::Identity(2, 2), &least).at(1).usable);  // not of a least element
  EXPECT_TRUE(ActiveSetTable(Matrix::Identity(2, 2), &least).at(2).usable);
}

TEST(OtherSolutions, AsASearchWithoutATable) {
  std::mt19937 generator(4);
  int with = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const Index n = trial % 4 + 1;
    Matrix M = draw(generator, n, n);
    if (trial % 3 == 0) M.row(0).setZero();
    const Vector q = draw(generator, n, 1);
    const auto y = oracle::solve_lcp(M, q, LcpClass::P);
    if (!y) continue;
    const bool expected = another_solution(M, q, *y).has_value();
    EXPECT_EQ(OtherSolutions(M).any(q, *y), expected) << trial;
    with += expected;
  }
  EXPECT_GT(with, 20);
}

}  // namespace
}  // namespace bromwich::active_set_table_test

// Facts of M from its stored entries, of the three forms of one matrix.

#include "core/lcp/entries.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace bromwich {
namespace {

// A tridiagonal matrix in all forms.
std::vector<LcpMatrix> forms(const Tridiagonal& t) {
  const Matrix dense = to_dense(LcpMatrix(t));
  return {t, dense, SparseLcpMatrix(dense.sparseView(0, -1))};
}

TEST(Entries, ZeroIsFoundInAllForms) {
  for (const Index n : {0, 1, 5}) {
    const Vector zero = Vector::Zero(n);
    for (const LcpMatrix& M : forms({zero, zero, zero})) EXPECT_TRUE(is_zero(M)) << n;
    if (n == 0) continue;
    for (const LcpMatrix& M : forms({zero, 1e-300 * Vector::Unit(n, n - 1), zero})) EXPECT_FALSE(is_zero(M)) << n;
  }
  EXPECT_TRUE(is_zero(SparseLcpMatrix(SparseMatrix(4, 4)))) << "nothing stored";
}

TEST(Entries, RegularMatricesAreToldFromSingularOnes) {
  const Vector ones = Vector::Ones(6);
  for (const LcpMatrix& M : forms({-ones, 2 * ones, -ones})) EXPECT_TRUE(is_regular(M));
  // The same with insulated ends: constants are in its null space.
  Vector diagonal = 2 * ones;
  diagonal[0] = diagonal[5] = 1;
  for (const LcpMatrix& M : forms({-ones, diagonal, -ones})) EXPECT_FALSE(is_regular(M));
  Vector gap = ones;
  gap[3] = 0;
  for (const LcpMatrix& M : forms({0 * ones, gap, 0 * ones})) EXPECT_FALSE(is_regular(M));
  for (const LcpMatrix& M : forms({0 * ones, -1e-9 * ones, 0 * ones})) EXPECT_TRUE(is_regular(M));
}

}  // namespace
}  // namespace bromwich

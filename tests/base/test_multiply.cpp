// Products of matrices, which the precompiled header turns into calls of `multiply`, against sums over the inner index.

#include "core/base/eigen_products.hpp"
#include "core/base/types.hpp"

#include <gtest/gtest.h>

#include <complex>
#include <limits>
#include <random>
#include <type_traits>

namespace bromwich {
namespace {

using Complex = std::complex<double>;
template <class Scalar, int order>
using MatrixOf = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic, order>;

template <class Scalar>
class Multiply : public testing::Test {
 protected:
  using Plain = MatrixOf<Scalar, Eigen::ColMajor>;

  template <int order>
  MatrixOf<Scalar, order> random(Index rows, Index cols) {
    return MatrixOf<Scalar, order>::NullaryExpr(rows, cols, [&] {
      if constexpr (std::is_same_v<Scalar, Complex>) {
        return Complex(uniform_(engine_), uniform_(engine_));
      } else {
        return uniform_(engine_);
      }
    });
  }

  // C0 + alpha A B by its definition, and whether C is equal to it. A sum of k products and the two operations after it
  // are off by at most (k + 2) units of rounding of the sum of absolute values (a complex product: 3 more each).
  void expect_product(const Plain& found, const Plain& before, Scalar alpha, const Plain& a, const Plain& b) {
    for (Index i = 0; i < found.rows(); ++i) {
      for (Index j = 0; j < found.cols(); ++j) {
        Scalar sum = 0;
        double size = 0;
        for (Index k = 0; k < a.cols(); ++k) {
          sum += a.coeff(i, k) * b.coeff(k, j);
          size += std::abs(a.coeff(i, k)) * std::abs(b.coeff(k, j));
        }
        const double bound = 4.0 * static_cast<double>(a.cols() + 2) * std::numeric_limits<double>::epsilon() *
                             (std::abs(before(i, j)) + std::abs(alpha) * size);
        ASSERT_LE(std::abs(found(i, j) - (before(i, j) + alpha * sum)), bound)
            << "rows " << found.rows() << " inner " << a.cols() << " columns " << found.cols() << " at " << i << ' '
            << j;
      }
    }
  }

  template <int order_c, int order_a, int order_b>
  void of_orders(Index rows, Index inner, Index cols) {
    static_assert(SharedProduct<MatrixOf<Scalar, order_a>, MatrixOf<Scalar, order_b>>);
    const auto a = random<order_a>(rows, inner);
    const auto b = random<order_b>(inner, cols);
    const auto at = random<order_a>(inner, rows);
    const auto wide = random<order_b>(inner + 3, cols + 2);
    const MatrixOf<Scalar, order_c> before = random<order_c>(rows, cols);
    const MatrixOf<Scalar, order_c> zero = MatrixOf<Scalar, order_c>::Zero(rows, cols);
    const Scalar s(-0.75);
    MatrixOf<Scalar, order_c> c = a * b;
    expect_product(c, zero, Scalar(1), a, b);
    c = before;
    c.noalias() += (s * a) * b;
    expect_product(c, before, s, a, b);
    c = before;
    c.noalias() -= a * wide.block(1, 2, inner, cols);
    expect_product(c, before, Scalar(-1), a, wide.block(1, 2, inner, cols));
    c.noalias() = at.transpose() * b;
    expect_product(c, zero, Scalar(1), at.transpose(), b);
    // Into a part of a larger matrix, the rest of which stays, and from an expression that lies nowhere in memory.
    MatrixOf<Scalar, order_c> larger = random<order_c>(rows + 2, cols + 1);
    const MatrixOf<Scalar, order_c> larger_before = larger;
    larger.block(1, 1, rows, cols).noalias() = (a + a) * b;
    c = larger.block(1, 1, rows, cols);
    expect_product(c, zero, Scalar(2), a, b);
    larger.block(1, 1, rows, cols) = larger_before.block(1, 1, rows, cols);
    ASSERT_EQ(larger, larger_before);
    // Every second row or column of a larger matrix.
    MatrixOf<Scalar, order_c> sparse = random<order_c>(2 * rows, 2 * cols);
    const MatrixOf<Scalar, order_c> sparse_before = sparse;
    using Strided = Eigen::Map<MatrixOf<Scalar, order_c>, 0, Eigen::Stride<Eigen::Dynamic, 2>>;
    Strided strided(sparse.data(), rows, cols,
                    Eigen::Stride<Eigen::Dynamic, 2>(2 * (order_c == Eigen::RowMajor ? 2 * cols : 2 * rows), 2));
    c = strided;
    strided.noalias() += a * b;
    const MatrixOf<Scalar, order_c> result = strided;
    expect_product(result, c, Scalar(1), a, b);
    strided = c;
    ASSERT_EQ(sparse, sparse_before);
  }

 private:
  std::mt19937 engine_{17};
  std::uniform_real_distribution<double> uniform_{-1, 1};
};

using Scalars = testing::Types<double, Complex>;
TYPED_TEST_SUITE(Multiply, Scalars);

// One row, one column, nothing inside; few entries, below and above the size from which blocked kernels run; beyond
// their panels.
TYPED_TEST(Multiply, IsTheSumOverTheInnerIndexInEveryOrder) {
  constexpr int C = Eigen::ColMajor;
  constexpr int R = Eigen::RowMajor;
  const Index sizes[][3] = {{2, 3, 4},   {1, 5, 3},   {1, 30, 1}, {40, 7, 1},   {1, 9, 33},
                            {1, 1, 1},   {5, 0, 4},   {5, 6, 7},  {23, 31, 29}, {64, 17, 130},
                            {200, 2, 3}, {3, 4, 200}, {70, 4, 4}, {70, 1, 2},   {1, 3, 90}};
  for (const auto& [rows, inner, cols] : sizes) {
    this->template of_orders<C, C, C>(rows, inner, cols);
    this->template of_orders<C, C, R>(rows, inner, cols);
    this->template of_orders<C, R, C>(rows, inner, cols);
    this->template of_orders<C, R, R>(rows, inner, cols);
    this->template of_orders<R, C, C>(rows, inner, cols);
    this->template of_orders<R, C, R>(rows, inner, cols);
    this->template of_orders<R, R, C>(rows, inner, cols);
    this->template of_orders<R, R, R>(rows, inner, cols);
  }
}

}  // namespace
}  // namespace bromwich

// C = alpha A B or C += alpha A B by Eigen's products of maps: one instance for each storage order of A and of B. Where
// C is row-major, C^T = B^T A^T is computed, as Eigen does. Products of few entries, and long ones by a matrix of at
// most 4 x 4, have loops of their own.
//
// Compiled without the precompiled header, in which eigen_products.hpp turns products into calls of this function.

#include "multiply.hpp"

#include <algorithm>
#include <utility>

namespace bromwich {
namespace {

// Of this source alone, and so are the instances of Eigen's templates for maps with it: the linker merges none of them
// with those of a source that has other products.
struct OwnStride : Eigen::OuterStride<> {
  using Eigen::OuterStride<>::OuterStride;
};

template <class Scalar, int order>
using Matrix = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic, order>;
template <class Scalar, int order>
using ConstMap = Eigen::Map<const Matrix<Scalar, order>, Eigen::Unaligned, OwnStride>;
template <class Scalar>
using ResultMap = Eigen::Map<Matrix<Scalar, Eigen::ColMajor>, Eigen::Unaligned, OwnStride>;

// A map with a stride is filled column by column, which are short where C is long and thin and row-major.
template <class Scalar>
void set_zero(ResultMap<Scalar>& C) {
  if (C.outerStride() == C.rows()) {
    std::fill_n(C.data(), C.size(), Scalar(0));
  } else {
    C.setZero();
  }
}

// What Eigen's product does where its factors' sizes are known at run time alone, except that alpha is applied here.
template <class Scalar, class Left, class Right>
void multiply_maps(ProductMode mode, ResultMap<Scalar>& C, const Left& A, const Right& B, Scalar alpha) {
  namespace eigen = Eigen::internal;
  using Product = eigen::generic_product_impl<Left, Right, Eigen::DenseShape, Eigen::DenseShape, Eigen::GemmProduct>;
  const bool small = B.rows() + C.rows() + C.cols() < EIGEN_GEMM_TO_COEFFBASED_THRESHOLD && B.rows() > 0;
  if (!small) {
    if (mode == ProductMode::assign) set_zero(C);
    Product::scaleAndAddTo(C, A, B, alpha);
  } else if (mode == ProductMode::assign) {
    if (alpha == Scalar(1)) {
      C.noalias() = A.lazyProduct(B);
    } else {
      C.noalias() = alpha * A.lazyProduct(B);
    }
  } else if (alpha == Scalar(1)) {
    C.noalias() += A.lazyProduct(B);
  } else {
    C.noalias() += alpha * A.lazyProduct(B);
  }
}

template <class Scalar, int order>
ConstMap<Scalar, order> map(const MatrixView<const Scalar>& A) {
  return {A.data, A.rows, A.cols, OwnStride(A.stride)};
}

template <class Scalar, int order_A>
void multiply_by(ProductMode mode, ResultMap<Scalar>& C, const MatrixView<const Scalar>& A,
                 const MatrixView<const Scalar>& B, Scalar alpha) {
  const auto left = map<Scalar, order_A>(A);
  if (B.row_major) {
    multiply_maps(mode, C, left, map<Scalar, Eigen::RowMajor>(B), alpha);
  } else {
    multiply_maps(mode, C, left, map<Scalar, Eigen::ColMajor>(B), alpha);
  }
}

template <class Scalar>
MatrixView<Scalar> transposed(const MatrixView<Scalar>& A) {
  return {A.data, A.cols, A.rows, A.stride, !A.row_major};
}

// Up to this many products of entries the sums are shorter than Eigen's way to them.
constexpr Eigen::Index few = 64;

// By the definition, in the order of the inner index as in Eigen's products of few coefficients.
void multiply_few(ProductMode mode, const MatrixView<double>& C, const MatrixView<const double>& A,
                  const MatrixView<const double>& B, double alpha) {
  const Eigen::Index row_A = A.row_major ? A.stride : 1, column_A = A.row_major ? 1 : A.stride;
  const Eigen::Index row_B = B.row_major ? B.stride : 1, column_B = B.row_major ? 1 : B.stride;
  const Eigen::Index row_C = C.row_major ? C.stride : 1, column_C = C.row_major ? 1 : C.stride;
  for (Eigen::Index j = 0; j < C.cols; ++j) {
    for (Eigen::Index i = 0; i < C.rows; ++i) {
      const double* a = A.data + i * row_A;
      const double* b = B.data + j * column_B;
      double sum = a[0] * b[0];
      for (Eigen::Index k = 1; k < A.cols; ++k) sum += a[k * column_A] * b[k * row_B];
      double& c = C.data[i * row_C + j * column_C];
      c = mode == ProductMode::add ? c + alpha * sum : alpha * sum;
    }
  }
}

// Up to so many rows and columns of B; Eigen packs its factors into panels, and of such a B most of a panel is empty.
constexpr Eigen::Index short_row = 4;

bool has_short_rows(const MatrixView<double>& C, const MatrixView<const double>& A) {
  return C.row_major && A.row_major && A.cols > 0 && A.cols <= short_row && C.cols > 0 && C.cols <= short_row;
}

// C = alpha A B or C += alpha A B, one row of C after the other; the compiler unrolls what a row takes.
template <int inner, int columns>
void multiply_rows(ProductMode mode, const MatrixView<double>& C, const MatrixView<const double>& A,
                   const MatrixView<const double>& B, double alpha) {
  double b[inner][columns];
  for (Eigen::Index k = 0; k < inner; ++k)
    for (Eigen::Index j = 0; j < columns; ++j)
      b[k][j] = B.row_major ? B.data[k * B.stride + j] : B.data[j * B.stride + k];
  const bool adds = mode == ProductMode::add;
  for (Eigen::Index i = 0; i < C.rows; ++i) {
    const double* a = A.data + i * A.stride;
    double* c = C.data + i * C.stride;
    double sum[columns];
    for (int j = 0; j < columns; ++j) sum[j] = a[0] * b[0][j];
    for (int k = 1; k < inner; ++k)
      for (int j = 0; j < columns; ++j) sum[j] += a[k] * b[k][j];
    for (int j = 0; j < columns; ++j) c[j] = adds ? c[j] + alpha * sum[j] : alpha * sum[j];
  }
}

template <int... sizes>
void multiply_rows(ProductMode mode, const MatrixView<double>& C, const MatrixView<const double>& A,
                   const MatrixView<const double>& B, double alpha, std::integer_sequence<int, sizes...>) {
  using Call = void (*)(ProductMode, const MatrixView<double>&, const MatrixView<const double>&,
                        const MatrixView<const double>&, double);
  constexpr Call calls[] = {multiply_rows<sizes / short_row + 1, sizes % short_row + 1>...};
  calls[(A.cols - 1) * short_row + C.cols - 1](mode, C, A, B, alpha);
}

void multiply_rows(ProductMode mode, const MatrixView<double>& C, const MatrixView<const double>& A,
                   const MatrixView<const double>& B, double alpha) {
  multiply_rows(mode, C, A, B, alpha, std::make_integer_sequence<int, short_row * short_row>());
}

template <class Scalar>
void multiply_views(ProductMode mode, const MatrixView<Scalar>& C, const MatrixView<const Scalar>& A,
                    const MatrixView<const Scalar>& B, Scalar alpha) {
  if (C.row_major) {
    multiply_views(mode, transposed(C), transposed(B), transposed(A), alpha);
    return;
  }
  ResultMap<Scalar> result(C.data, C.rows, C.cols, OwnStride(C.stride));
  if (A.row_major) {
    multiply_by<Scalar, Eigen::RowMajor>(mode, result, A, B, alpha);
  } else {
    multiply_by<Scalar, Eigen::ColMajor>(mode, result, A, B, alpha);
  }
}

}  // namespace

void multiply(ProductMode mode, const MatrixView<double>& C, const MatrixView<const double>& A,
              const MatrixView<const double>& B, double alpha) {
  if (A.cols > 0 && C.rows * C.cols * A.cols <= few) return multiply_few(mode, C, A, B, alpha);
  if (has_short_rows(C, A)) return multiply_rows(mode, C, A, B, alpha);
  if (has_short_rows(transposed(C), transposed(B)))
    return multiply_rows(mode, transposed(C), transposed(B), transposed(A), alpha);
  multiply_views(mode, C, A, B, alpha);
}

void multiply(ProductMode mode, const MatrixView<std::complex<double>>& C,
              const MatrixView<const std::complex<double>>& A, const MatrixView<const std::complex<double>>& B,
              std::complex<double> alpha) {
  multiply_views(mode, C, A, B, alpha);
}

}  // namespace bromwich

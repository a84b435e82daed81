#pragma once
// Products of matrices in memory, compiled once: what Eigen's products of expressions become (eigen_products.hpp).

#include <Eigen/Core>

#include <complex>

namespace bromwich {

/// A matrix in memory: entry (i, j) at data[i * stride + j] if row_major, else at data[i + j * stride].
template <class Scalar>
struct MatrixView {
  Scalar* data;
  Eigen::Index rows;
  Eigen::Index cols;
  Eigen::Index stride;
  bool row_major;
};

enum class ProductMode { assign, add };

/// C = alpha A B (assign) or C += alpha A B (add), A r x k, B k x c, C r x c, which overlaps neither. Small ones
/// coefficient by coefficient, others by Eigen's blocked kernels, as Eigen chooses.
void multiply(ProductMode mode, const MatrixView<double>& C, const MatrixView<const double>& A,
              const MatrixView<const double>& B, double alpha);
void multiply(ProductMode mode, const MatrixView<std::complex<double>>& C,
              const MatrixView<const std::complex<double>>& A, const MatrixView<const std::complex<double>>& B,
              std::complex<double> alpha);

}  // namespace bromwich

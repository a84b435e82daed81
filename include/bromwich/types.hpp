#pragma once
// Index and array types. A space-time array holds one row per time point (row 0 is t = 0) and one column per
// constraint, mode or state; rows are contiguous.

#include <Eigen/Core>
#include <Eigen/SparseCore>

#include <complex>

namespace bromwich {

using Index = Eigen::Index;
using Complex = std::complex<double>;

using Vector = Eigen::VectorXd;
using Matrix = Eigen::MatrixXd;
using ComplexVector = Eigen::VectorXcd;
using ComplexMatrix = Eigen::MatrixXcd;

/// Compressed sparse columns.
using SparseMatrix = Eigen::SparseMatrix<double>;

/// A space-time array on the host: (J+1) x n, row j belongs to time t_j.
using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

}  // namespace bromwich

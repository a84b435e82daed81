#pragma once
// Eigen's factorizations of Matrix are used everywhere and take seconds to compile: they are instantiated once, in
// eigen_instances.cpp. Include this header in precompiled headers only; without it every source instantiates its own.

#include <Eigen/Dense>

#ifndef BROMWICH_EIGEN_INSTANCE
#define BROMWICH_EIGEN_INSTANCE extern template
#endif

namespace Eigen {

BROMWICH_EIGEN_INSTANCE class PartialPivLU<MatrixXd>;
BROMWICH_EIGEN_INSTANCE class PartialPivLU<MatrixXcd>;
BROMWICH_EIGEN_INSTANCE class FullPivLU<MatrixXd>;
BROMWICH_EIGEN_INSTANCE class HouseholderQR<MatrixXd>;
BROMWICH_EIGEN_INSTANCE class ColPivHouseholderQR<MatrixXd>;
BROMWICH_EIGEN_INSTANCE class CompleteOrthogonalDecomposition<MatrixXd>;
BROMWICH_EIGEN_INSTANCE class JacobiSVD<MatrixXd>;
BROMWICH_EIGEN_INSTANCE class SelfAdjointEigenSolver<MatrixXd>;
BROMWICH_EIGEN_INSTANCE class EigenSolver<MatrixXd>;
BROMWICH_EIGEN_INSTANCE class RealSchur<MatrixXd>;
BROMWICH_EIGEN_INSTANCE class LDLT<MatrixXd>;
BROMWICH_EIGEN_INSTANCE class LLT<MatrixXd>;

namespace internal {

using DoubleTraits = gebp_traits<double, double>;
using DoubleMapper = blas_data_mapper<double, Index, ColMajor, Unaligned, 1>;
BROMWICH_EIGEN_INSTANCE struct gebp_kernel<double, double, Index, DoubleMapper, DoubleTraits::mr, DoubleTraits::nr,
                                           false, false>;

}  // namespace internal

}  // namespace Eigen

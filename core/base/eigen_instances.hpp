#pragma once
// Eigen's factorizations of Matrix are used everywhere and take seconds to compile: they are instantiated once, in
// eigen_instances.cpp. Include this header in precompiled headers only; without it every source instantiates its own.

#include "eigen_products.hpp"

#include <Eigen/Dense>
#include <Eigen/Sparse>

#ifndef BROMWICH_EIGEN_INSTANCE
#define BROMWICH_EIGEN_INSTANCE extern template
#endif

namespace Eigen {

// Members that are used and take long to compile. Whole classes would have a third more, which nothing uses.
BROMWICH_EIGEN_INSTANCE void PartialPivLU<MatrixXd>::compute();
BROMWICH_EIGEN_INSTANCE void PartialPivLU<MatrixXcd>::compute();
BROMWICH_EIGEN_INSTANCE void FullPivLU<MatrixXd>::computeInPlace();
BROMWICH_EIGEN_INSTANCE void HouseholderQR<MatrixXd>::computeInPlace();
BROMWICH_EIGEN_INSTANCE void ColPivHouseholderQR<MatrixXd>::computeInPlace();
BROMWICH_EIGEN_INSTANCE void CompleteOrthogonalDecomposition<MatrixXd>::computeInPlace();
BROMWICH_EIGEN_INSTANCE JacobiSVD<MatrixXd>& JacobiSVD<MatrixXd>::compute(const MatrixXd&, unsigned int);
BROMWICH_EIGEN_INSTANCE SelfAdjointEigenSolver<MatrixXd>& SelfAdjointEigenSolver<MatrixXd>::computeFromTridiagonal(
    const VectorXd&, const VectorXd&, int);
BROMWICH_EIGEN_INSTANCE GeneralizedSelfAdjointEigenSolver<MatrixXd>&
GeneralizedSelfAdjointEigenSolver<MatrixXd>::compute(const MatrixXd&, const MatrixXd&, int);
BROMWICH_EIGEN_INSTANCE MatrixXcd EigenSolver<MatrixXd>::eigenvectors() const;
BROMWICH_EIGEN_INSTANCE void SparseLU<SparseMatrix<double>, COLAMDOrdering<int>>::analyzePattern(
    const SparseMatrix<double>&);
BROMWICH_EIGEN_INSTANCE void SparseLU<SparseMatrix<double>, COLAMDOrdering<int>>::factorize(
    const SparseMatrix<double>&);
BROMWICH_EIGEN_INSTANCE void SparseLU<SparseMatrix<std::complex<double>>, COLAMDOrdering<int>>::analyzePattern(
    const SparseMatrix<std::complex<double>>&);
BROMWICH_EIGEN_INSTANCE void SparseLU<SparseMatrix<std::complex<double>>, COLAMDOrdering<int>>::factorize(
    const SparseMatrix<std::complex<double>>&);

// Members that are templates. These hold for arguments that are matrices: an expression makes an instance of its own,
// so write SelfAdjointEigenSolver<Matrix>(Matrix(A + A.transpose())).
BROMWICH_EIGEN_INSTANCE EigenSolver<MatrixXd>& EigenSolver<MatrixXd>::compute(const EigenBase<MatrixXd>&, bool);
BROMWICH_EIGEN_INSTANCE RealSchur<MatrixXd>& RealSchur<MatrixXd>::compute(const EigenBase<MatrixXd>&, bool);
BROMWICH_EIGEN_INSTANCE SelfAdjointEigenSolver<MatrixXd>& SelfAdjointEigenSolver<MatrixXd>::compute(
    const EigenBase<MatrixXd>&, int);
BROMWICH_EIGEN_INSTANCE LDLT<MatrixXd>& LDLT<MatrixXd>::compute(const EigenBase<MatrixXd>&);
BROMWICH_EIGEN_INSTANCE LLT<MatrixXd>& LLT<MatrixXd>::compute(const EigenBase<MatrixXd>&);
BROMWICH_EIGEN_INSTANCE void FullPivLU<MatrixXd>::_solve_impl(const VectorXd&, VectorXd&) const;
BROMWICH_EIGEN_INSTANCE void FullPivLU<MatrixXd>::_solve_impl(const MatrixXd&, MatrixXd&) const;
BROMWICH_EIGEN_INSTANCE void FullPivLU<MatrixXd>::_solve_impl(const MatrixXd::IdentityReturnType&, MatrixXd&) const;
BROMWICH_EIGEN_INSTANCE void HouseholderQR<MatrixXd>::_solve_impl(const VectorXd&, VectorXd&) const;
BROMWICH_EIGEN_INSTANCE void ColPivHouseholderQR<MatrixXd>::_solve_impl(const VectorXd&, VectorXd&) const;
BROMWICH_EIGEN_INSTANCE void CompleteOrthogonalDecomposition<MatrixXd>::_solve_impl(const VectorXd&, VectorXd&) const;
BROMWICH_EIGEN_INSTANCE void CompleteOrthogonalDecomposition<MatrixXd>::_solve_impl(const MatrixXd&, MatrixXd&) const;

namespace internal {

BROMWICH_EIGEN_INSTANCE double rcond_estimate_helper(double, const PartialPivLU<MatrixXd>&);
BROMWICH_EIGEN_INSTANCE double rcond_estimate_helper(double, const PartialPivLU<MatrixXcd>&);
BROMWICH_EIGEN_INSTANCE double rcond_estimate_helper(double, const FullPivLU<MatrixXd>&);

using ComplexNumber = std::complex<double>;
using DoubleTraits = gebp_traits<double, double>;
using DoubleMapper = blas_data_mapper<double, Index, ColMajor, Unaligned, 1>;
BROMWICH_EIGEN_INSTANCE struct gebp_kernel<double, double, Index, DoubleMapper, DoubleTraits::mr, DoubleTraits::nr,
                                           false, false>;

using ComplexTraits = gebp_traits<ComplexNumber, ComplexNumber>;
using ComplexMapper = blas_data_mapper<ComplexNumber, Index, ColMajor, Unaligned, 1>;
BROMWICH_EIGEN_INSTANCE struct gebp_kernel<ComplexNumber, ComplexNumber, Index, ComplexMapper, ComplexTraits::mr,
                                           ComplexTraits::nr, false, false>;

template <class Scalar, int order>
using ConstMapper = const_blas_data_mapper<Scalar, Index, order>;
BROMWICH_EIGEN_INSTANCE struct gemm_pack_lhs<double, Index, ConstMapper<double, ColMajor>, DoubleTraits::mr,
                                             DoubleTraits::LhsProgress, DoubleTraits::LhsPacket4Packing, ColMajor>;
BROMWICH_EIGEN_INSTANCE struct gemm_pack_lhs<double, Index, ConstMapper<double, RowMajor>, DoubleTraits::mr,
                                             DoubleTraits::LhsProgress, DoubleTraits::LhsPacket4Packing, RowMajor>;
BROMWICH_EIGEN_INSTANCE struct gemm_pack_rhs<double, Index, ConstMapper<double, ColMajor>, DoubleTraits::nr, ColMajor>;
BROMWICH_EIGEN_INSTANCE struct gemm_pack_rhs<double, Index, ConstMapper<double, RowMajor>, DoubleTraits::nr, RowMajor>;
BROMWICH_EIGEN_INSTANCE struct triangular_solve_matrix<double, Index, OnTheLeft, Upper, false, ColMajor, ColMajor, 1>;
BROMWICH_EIGEN_INSTANCE struct triangular_solve_matrix<double, Index, OnTheLeft, UnitLower, false, ColMajor, ColMajor,
                                                       1>;
BROMWICH_EIGEN_INSTANCE struct triangular_solve_matrix<ComplexNumber, Index, OnTheLeft, Upper, false, ColMajor,
                                                       ColMajor, 1>;
BROMWICH_EIGEN_INSTANCE struct triangular_solve_matrix<ComplexNumber, Index, OnTheLeft, UnitLower, false, ColMajor,
                                                       ColMajor, 1>;
BROMWICH_EIGEN_INSTANCE struct general_matrix_vector_product<Index, double, ConstMapper<double, RowMajor>, RowMajor,
                                                             false, double, ConstMapper<double, ColMajor>, false, 0>;
BROMWICH_EIGEN_INSTANCE struct general_matrix_vector_product<Index, ComplexNumber, ConstMapper<ComplexNumber, RowMajor>,
                                                             RowMajor, false, ComplexNumber,
                                                             ConstMapper<ComplexNumber, ColMajor>, false, 0>;
BROMWICH_EIGEN_INSTANCE struct triangular_solve_vector<double, double, Index, OnTheLeft, Upper, false, ColMajor>;
BROMWICH_EIGEN_INSTANCE struct triangular_solve_vector<double, double, Index, OnTheLeft, UnitLower, false, ColMajor>;
BROMWICH_EIGEN_INSTANCE struct triangular_solve_vector<ComplexNumber, ComplexNumber, Index, OnTheLeft, Upper, false,
                                                       ColMajor>;
BROMWICH_EIGEN_INSTANCE struct triangular_solve_vector<ComplexNumber, ComplexNumber, Index, OnTheLeft, UnitLower, false,
                                                       ColMajor>;
// Solves by the factor L of a SparseLU.
BROMWICH_EIGEN_INSTANCE void MappedSuperNodalMatrix<double, int>::solveInPlace(MatrixBase<VectorXd>&) const;
BROMWICH_EIGEN_INSTANCE void MappedSuperNodalMatrix<double, int>::solveInPlace(MatrixBase<MatrixXd>&) const;
BROMWICH_EIGEN_INSTANCE void MappedSuperNodalMatrix<ComplexNumber, int>::solveInPlace(MatrixBase<MatrixXcd>&) const;
// What a HouseholderSequence applies to matrices.
BROMWICH_EIGEN_INSTANCE void apply_block_householder_on_the_left(Block<MatrixXd>&, const Block<MatrixXd>&,
                                                                 const VectorBlock<const VectorXd>&, bool);
BROMWICH_EIGEN_INSTANCE double rcond_invmatrix_L1_norm_estimate(const PartialPivLU<MatrixXd>&);
BROMWICH_EIGEN_INSTANCE double rcond_invmatrix_L1_norm_estimate(const PartialPivLU<MatrixXcd>&);
BROMWICH_EIGEN_INSTANCE double rcond_invmatrix_L1_norm_estimate(const FullPivLU<MatrixXd>&);

}  // namespace internal

}  // namespace Eigen

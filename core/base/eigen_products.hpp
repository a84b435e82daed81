#pragma once
// Products of two matrices, compiled once. Eigen instantiates its kernels, and for each of them the products with one
// row or column, for every pair of expressions that is multiplied: blocks, transposes, maps, multiples. That was two
// fifths of the compiler's time. Here every such product of real, or of complex, matrices becomes a call of `multiply`,
// which runs the same kernels of Eigen on plain views. For precompiled headers only (eigen_instances.hpp): a source
// without it instantiates Eigen's own product, which has the same values.

#include "multiply.hpp"

#include <Eigen/Core>

#include <complex>
#include <concepts>

namespace bromwich {

/// Sizes known at run time alone, and no conjugates that Eigen's kernels would take on the way.
template <class Operand>
concept SharedOperand =
    (std::same_as<typename Operand::Scalar, double> ||
     std::same_as<typename Operand::Scalar, std::complex<double>>)&&int(Operand::MaxRowsAtCompileTime) ==
        Eigen::Dynamic&& int(Operand::MaxColsAtCompileTime) == Eigen::Dynamic
    && !bool(Eigen::internal::blas_traits<Operand>::NeedToConjugate);

template <class Left, class Right>
concept SharedProduct =
    SharedOperand<Left> && SharedOperand<Right> && std::same_as<typename Left::Scalar, typename Right::Scalar>;

}  // namespace bromwich

namespace Eigen::internal {

template <class Lhs, class Rhs>
requires bromwich::SharedProduct<Lhs, Rhs>
struct generic_product_impl<Lhs, Rhs, DenseShape, DenseShape, GemmProduct>
    : generic_product_impl_base<Lhs, Rhs, generic_product_impl<Lhs, Rhs, DenseShape, DenseShape, GemmProduct>> {
  using Scalar = typename Lhs::Scalar;
  using Mode = bromwich::ProductMode;

  template <class Dst>
  static void evalTo(Dst& dst, const Lhs& lhs, const Rhs& rhs) {
    run(Mode::assign, dst, lhs, rhs, Scalar(1));
  }
  template <class Dst>
  static void addTo(Dst& dst, const Lhs& lhs, const Rhs& rhs) {
    run(Mode::add, dst, lhs, rhs, Scalar(1));
  }
  template <class Dst>
  static void subTo(Dst& dst, const Lhs& lhs, const Rhs& rhs) {
    run(Mode::add, dst, lhs, rhs, Scalar(-1));
  }
  template <class Dst>
  static void scaleAndAddTo(Dst& dst, const Lhs& lhs, const Rhs& rhs, const Scalar& alpha) {
    run(Mode::add, dst, lhs, rhs, alpha);
  }

 private:
  template <class Expression>
  static bromwich::MatrixView<const Scalar> view(const Expression& e) {
    return {e.data(), e.rows(), e.cols(), e.outerStride(), bool(Expression::IsRowMajor)};
  }

  template <class Dst>
  static void run(Mode mode, Dst& dst, const Lhs& a, const Rhs& b, const Scalar& alpha) {
    if constexpr (int(inner_stride_at_compile_time<Dst>::ret) == 1) {
      // References to what lies in memory, values of what has to be computed first.
      typename add_const_on_value_type<typename blas_traits<Lhs>::DirectLinearAccessType>::type lhs =
          blas_traits<Lhs>::extract(a);
      typename add_const_on_value_type<typename blas_traits<Rhs>::DirectLinearAccessType>::type rhs =
          blas_traits<Rhs>::extract(b);
      const bromwich::MatrixView<Scalar> result{dst.data(), dst.rows(), dst.cols(), dst.outerStride(),
                                                bool(Dst::IsRowMajor)};
      bromwich::multiply(mode, result, view(lhs), view(rhs), combine_scalar_factors(alpha, a, b));
    } else {
      Matrix<Scalar, Dynamic, Dynamic> packed = dst;
      run(mode, packed, a, b, alpha);
      dst = packed;
    }
  }
};

}  // namespace Eigen::internal

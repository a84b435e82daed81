#pragma once
// Values of w at t = 0 that are zero but for rounding.
//
// An x0 on a constraint is often the end of another solve, whose terms may have been larger than those of N x0 + g(0).
// What they were is not known: the motion within T says how large they may be.

#include "../numerics/equilibration.hpp"

namespace bromwich {

inline constexpr double rounding_of_restarts = 0x1p-36;  ///< of the terms of w

/// m x m: how far constant x' without A x move the states within T, T |(I - TA)^{-1}|. Fast modes that decay count with
/// the states to which they tend.
inline Matrix motion_within(double T, const Matrix& A) {
  constexpr double regular = 1e-8;
  const Matrix I = Matrix::Identity(A.rows(), A.rows());
  const Eigen::PartialPivLU<Matrix> lu(I - T * A);
  return T * (A.rows() > 0 && reciprocal_condition(lu) > regular ? Matrix(Matrix(lu.inverse()).cwiseAbs()) : I);
}

/// The sizes of the terms of N x + g on [0, T]: |N| (|x0| + T |(I - TA)^{-1}| |A x0 + f(0)|) + |g|. `f`: f(0); `g`:
/// largest absolute values.
inline Vector terms_of_motion(const Matrix& A, const Matrix& N, const Vector& x0, const Vector& f, const Vector& g,
                              double T) {
  const Vector moved = motion_within(T, A) * ((A * x0).cwiseAbs() + f.cwiseAbs());
  return N.cwiseAbs() * (x0.cwiseAbs() + moved) + g.cwiseAbs();
}

inline constexpr double at_rest = 1e-8;  ///< of what y may move: a smaller state is rounding of the terms that hold it

}  // namespace bromwich

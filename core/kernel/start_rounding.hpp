#pragma once
// Values of w at t = 0 that are zero but for rounding.
//
// An x0 on a constraint is often the end of another solve, whose terms may have been larger than those of N x0 + g(0).
// What they were is not known: the motion within T says how large they may be.

#include "../numerics/equilibration.hpp"

namespace bromwich {

inline constexpr double rounding_of_restarts = 0x1p-36;  ///< of the terms of w

/// The sizes of the terms of N x + g on [0, T]: |N| (|x0| + T |(I - TA)^{-1}| |A x0 + f(0)|) + |g|. Fast modes that
/// decay count with the states to which they tend. `f`: f(0); `g`: largest absolute values.
inline Vector terms_of_motion(const Matrix& A, const Matrix& N, const Vector& x0, const Vector& f, const Vector& g,
                              double T) {
  constexpr double regular = 1e-8;
  Vector moved = T * ((A * x0).cwiseAbs() + f.cwiseAbs());
  const Eigen::PartialPivLU<Matrix> lu(Matrix(Matrix::Identity(A.rows(), A.rows()) - T * A));
  if (A.rows() > 0 && reciprocal_condition(lu) > regular) moved = Matrix(lu.inverse()).cwiseAbs() * moved;
  return N.cwiseAbs() * (x0.cwiseAbs() + moved) + g.cwiseAbs();
}

}  // namespace bromwich

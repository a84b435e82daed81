#pragma once
// The comparison matrix <M> (|m_ii| on the diagonal, -|m_ij| off it) and systems with it.

#include "matrix.hpp"

#include <Eigen/LU>
#include <Eigen/SparseLU>

#include <memory>

namespace bromwich {

class Comparison {
 public:
  explicit Comparison(const LcpMatrix&);

  /// <M> is a nonsingular M-matrix: the solution u of <M> u = diag|M| and <M> u are positive beyond rounding.
  bool is_M_matrix() const;

  /// <M> u = b.
  Vector solve(const Vector& b) const;

 private:
  Vector solve_tridiagonal(const Vector& b) const;

  LcpMatrix C_;  ///< <M>
  Eigen::PartialPivLU<Matrix> lu_;
  std::shared_ptr<Eigen::SparseLU<SparseMatrix>> sparse_lu_;  ///< of a sparse <M>
};

}  // namespace bromwich

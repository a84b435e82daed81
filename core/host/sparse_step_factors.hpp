#pragma once
// Factorization of one sparse map of a chain.

#include "step_map.hpp"

#include <Eigen/SparseLU>

namespace bromwich {

struct SparseStepFactors {
  /// LU factorization of S with partial pivoting.
  explicit SparseStepFactors(const StepMap&);

  /// S^{-T} b. Thread-safe: Eigen's transposed view is a local object.
  Matrix solve_transposed(const Matrix& b) { return lu.transpose().solve(b); }
  Vector solve_transposed(const Vector& b) { return lu.transpose().solve(b); }

  SparseMatrix R, change;  ///< R, R - S
  Eigen::SparseLU<SparseMatrix> lu;
  bool singular = false;  ///< to rounding
};

}  // namespace bromwich

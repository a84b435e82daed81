#pragma once

#include "linear_system.hpp"

namespace bromwich {

/// A, B, N and E as sparse matrices: many states (10^5 and more), few constraints. Such scenes are solved through their
/// kernel (shifted sparse solves) or by stepping the state with one sparse factorization.
struct SparseDynamics {
  SparseMatrix A;       ///< m x m
  SparseMatrix B;       ///< m x n
  SparseMatrix N;       ///< n x m
  SparseMatrix E = {};  ///< m x m, or empty
};

std::shared_ptr<LinearSystem> linear_system(SparseDynamics);

}  // namespace bromwich

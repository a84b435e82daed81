#pragma once

#include "linear_system.hpp"

namespace bromwich {

/// A, B, N and E as dense matrices.
struct DenseDynamics {
  Matrix A;       ///< m x m
  Matrix B;       ///< m x n
  Matrix N;       ///< n x m
  Matrix E = {};  ///< m x m, or empty
};

std::shared_ptr<LinearSystem> linear_system(DenseDynamics);

}  // namespace bromwich

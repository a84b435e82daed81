#pragma once

#include "../base/types.hpp"

namespace bromwich {

/// E0 x(0) + ET x(T) = b instead of x(0) = x0: initial values (I, 0), periodic (I, -I), separated or coupled ends.
struct BoundaryCondition {
  Matrix E0, ET;  ///< m x m
  Vector b;       ///< m
};

}  // namespace bromwich

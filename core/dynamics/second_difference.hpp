#pragma once

#include "../base/types.hpp"

namespace bromwich {

/// c/dx^2 tridiag(1, -2, 1) with `points` rows: the second difference with homogeneous Dirichlet ends.
/// Its eigenvectors are the sine vectors sqrt(2/(points+1)) sin(pi i k/(points+1)).
struct SecondDifference {
  Index points = 0;
  double spacing = 0;      ///< dx
  double diffusivity = 0;  ///< c

  /// lambda_k = -4 c/dx^2 sin^2(k pi / (2(points+1))), k = 1..points, decreasing.
  Vector eigenvalues() const;
};

}  // namespace bromwich

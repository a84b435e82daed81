#pragma once

#include "../numerics/face_basis.hpp"

namespace bromwich {

/// c/dx^2 tridiag(1, -2, 1) - r I with `points` rows: the second difference on one grid line, with homogeneous
/// Dirichlet ends unless `first` and `last` say otherwise. It is symmetric for all ends.
struct SecondDifference {
  Index points = 0;
  double spacing = 0;      ///< dx
  double diffusivity = 0;  ///< c
  /// Reflections q at the ends: the value beyond an end is q times that of the last point, -1 < q <= 1. 0: Dirichlet,
  /// at the distance dx; 1: Neumann, (1 - a dx/2)/(1 + a dx/2): Robin du/dn = -a u, both at dx/2.
  double first = 0, last = 0;
  double decay = 0;  ///< r, 1/time

  /// Whether its eigenvectors are the sine vectors sqrt(2/(points+1)) sin(pi i k/(points+1)).
  bool has_sine_modes() const { return first == 0 && last == 0; }
  /// -4 c/dx^2 sin^2(theta_k/2) - r, k = 1..points, decreasing.
  Vector eigenvalues() const;
  /// Q, points x points: orthonormal eigenvectors in its columns, in the order of `eigenvalues`.
  Matrix modes() const;
  /// The same as the basis of a direction. Bases in use are shared.
  FaceBasis basis() const;
  /// Q^T v.
  Vector in_modes(const Vector& v) const;
};

}  // namespace bromwich

#pragma once

#include "linear_system.hpp"
#include "second_difference.hpp"

namespace bromwich {

/// A = I ⊗ across + along ⊗ I on a rectangle, B = I ⊗ b, N = I ⊗ n^T: the constraints sit on one side of the
/// rectangle, one per grid line of `along`. State index = line * across.points + position on the line.
/// Sine transforms diagonalise A, so nothing of size m x m is ever formed.
struct KroneckerDynamics {
  SecondDifference along;   ///< n points: along the constrained side
  SecondDifference across;  ///< points of one grid line, counted from the constrained side
  Vector b;                 ///< across.points: input of y of a line to the line
  Vector n;                 ///< across.points: output of the line to its constraint
};

std::shared_ptr<LinearSystem> linear_system(KroneckerDynamics);

/// The Kronecker sum as sparse matrices, at any size.
SparseDynamics to_sparse(const KroneckerDynamics&);

}  // namespace bromwich

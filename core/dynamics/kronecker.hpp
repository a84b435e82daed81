#pragma once

#include "linear_system.hpp"
#include "second_difference.hpp"

#include <vector>

namespace bromwich {

/// A Kronecker sum of second differences on a box, A = I ⊗ across + face ⊗ I, face = along ⊗ I + I ⊗ beside[0] + ..., B
/// = I ⊗ b, N = I ⊗ n^T. The constraints are on one face of the box (one side of a rectangle), one for each grid line
/// across it. State index = face index * across.points + position on the line; the face index counts points of `along`
/// slowest and of the last direction of `beside` fastest. Transforms of each direction diagonalise the face, sine
/// transforms between Dirichlet ends and products with its modes elsewhere; the modes of one line diagonalise what is
/// left. So nothing of size m x m is ever formed.
struct KroneckerDynamics {
  SecondDifference along;                     ///< along the constrained side
  SecondDifference across;                    ///< points of one grid line, counted from the constrained face
  Vector b;                                   ///< across.points: input of y of a line to the line
  Vector n;                                   ///< across.points: output of the line to its constraint
  std::vector<SecondDifference> beside = {};  ///< further directions of the face; empty: a rectangle

  std::vector<SecondDifference> face() const;  ///< all directions of the face
  FaceBasis face_basis() const;                ///< their modes
  Index face_points() const;                   ///< n, the product of the extents
  Vector face_eigenvalues() const;             ///< n: the sums of one eigenvalue of each direction
};

std::shared_ptr<LinearSystem> linear_system(KroneckerDynamics);

/// The Kronecker sum as sparse matrices, at any size.
SparseDynamics to_sparse(const KroneckerDynamics&);

}  // namespace bromwich

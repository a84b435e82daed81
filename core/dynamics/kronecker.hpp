#pragma once

#include "linear_system.hpp"
#include "second_difference.hpp"

#include <vector>

namespace bromwich {

/// A Kronecker sum of second differences on a box, A = I ⊗ across + face ⊗ I, face = along ⊗ I + I ⊗ beside[0] + ..., B
/// = I ⊗ b, N = I ⊗ n^T. The constraints are on one face of the box (one side of a rectangle), one for each grid line
/// across it, or on the opposite one, too. State index = face index * across.points + position on the line; the face
/// index counts points of `along` slowest and of the last direction of `beside` fastest. Transforms of each direction
/// diagonalise the face, sine transforms between Dirichlet ends and products with its modes elsewhere; the modes of one
/// line diagonalise what is left. So nothing of size m x m is ever formed.
///
/// Constraints on both faces. R counts the points of a line from the other end; a line that is the same from both has
/// R across R = across. With the two views x and R x of a line, their sum and their difference over sqrt(2), and those
/// of y and w of both faces,
///
///     v' = across v + (b ± R b) y,     w = n^T v + ...
///
/// So the two faces are one more direction of a face with twice as many lines, of two points and with the modes (1, 1)
/// and (1, -1) over sqrt(2), and the lines of its two modes differ in b alone: they make two families of lines.
struct KroneckerDynamics {
  SecondDifference along;                     ///< along the constrained side
  SecondDifference across;                    ///< points of one grid line, counted from the constrained face
  Vector b;                                   ///< across.points: input of y of a line to the line
  Vector n;                                   ///< across.points: output of the line to its constraint
  std::vector<SecondDifference> beside = {};  ///< further directions of the face; empty: a rectangle
  /// Constraints on the opposite face behind those on the first one, with the same b and n counted from there. The two
  /// ends of `across` are then equal.
  bool both_faces = false;

  std::vector<SecondDifference> face() const;  ///< all directions of one face
  FaceBasis face_basis() const;                ///< their modes, those of the two faces first if there are two
  Index lines() const;                         ///< the product of the extents
  Index face_points() const;                   ///< n: one for each line and each face
  Vector face_eigenvalues() const;             ///< n: the sums of one eigenvalue of each direction, for each mode

  Index families() const { return both_faces ? 2 : 1; }
  Index family(Index mode) const { return mode / lines(); }
  Vector input(Index family) const;  ///< b, or b + R b and b - R b
  /// K x families: `input` in the modes of a line.
  Matrix inputs_in_modes() const;
  /// Numbers of a line, K x 1 or K x families, for the line of each mode: K x n.
  RowMatrix of_modes(const Matrix& of_families) const;
  /// x, n x across.points by rows: the lines as seen from each face.
  Vector views(const Vector& x) const;
};

std::shared_ptr<LinearSystem> linear_system(KroneckerDynamics);

/// The Kronecker sum as sparse matrices, at any size.
SparseDynamics to_sparse(const KroneckerDynamics&);

}  // namespace bromwich

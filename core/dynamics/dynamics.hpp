#pragma once
// Linear dynamics x' = A x + B y and what the constraints see of them, N x.

#include "../base/types.hpp"

#include <variant>

namespace bromwich {

/// A, B and N as dense matrices.
struct DenseDynamics {
  Matrix A;  ///< m x m
  Matrix B;  ///< m x n
  Matrix N;  ///< n x m
};

/// c/dx^2 tridiag(1, -2, 1) with `points` rows: the second difference with homogeneous Dirichlet ends.
/// Its eigenvectors are the sine vectors sqrt(2/(points+1)) sin(pi i k/(points+1)).
struct SecondDifference {
  Index points = 0;
  double spacing = 0;      ///< dx
  double diffusivity = 0;  ///< c

  /// lambda_k = -4 c/dx^2 sin^2(k pi / (2(points+1))), k = 1..points, decreasing.
  Vector eigenvalues() const;
};

/// A = I ⊗ across + along ⊗ I on a rectangle, B = I ⊗ b, N = I ⊗ n^T: the constraints sit on one side of the
/// rectangle, one per grid line of `along`. State index = line * across.points + position on the line.
/// Sine transforms diagonalise A, so nothing of size m x m is ever formed.
struct KroneckerDynamics {
  SecondDifference along;   ///< n points: along the constrained side
  SecondDifference across;  ///< points of one grid line, counted from the constrained side
  Vector b;                 ///< across.points: how y of a line drives the line
  Vector n;                 ///< across.points: how the line is seen by its constraint
};

/// A, B and N as sparse matrices: many states (10^5 and more), few constraints. Every scene of this form is solved
/// through its kernel (shifted sparse solves) or by stepping the state with one sparse factorization.
struct SparseDynamics {
  SparseMatrix A;  ///< m x m
  SparseMatrix B;  ///< m x n
  SparseMatrix N;  ///< n x m
};

using Dynamics = std::variant<DenseDynamics, KroneckerDynamics, SparseDynamics>;

Index states(const Dynamics&);
Index constraints(const Dynamics&);

/// A, B and N written out densely: for small scenes and as an oracle. Throws Error above 4096 states.
DenseDynamics to_dense(const Dynamics&);

/// The Kronecker sum as sparse matrices, at any size.
SparseDynamics to_sparse(const KroneckerDynamics&);

/// N x for one state.
Vector observe(const Dynamics&, const Vector& x);

}  // namespace bromwich

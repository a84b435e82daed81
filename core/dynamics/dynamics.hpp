#pragma once
// Linear dynamics E x' = A x + B y and their output to the constraints, N x. E has to be regular; by default it is the
// identity.

#include "../base/types.hpp"
#include "spectral_bound.hpp"

#include <functional>
#include <optional>
#include <variant>

namespace bromwich {

/// A, B, N and E as dense matrices.
struct DenseDynamics {
  Matrix A;       ///< m x m
  Matrix B;       ///< m x n
  Matrix N;       ///< n x m
  Matrix E = {};  ///< m x m, or empty
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
  Vector b;                 ///< across.points: input of y of a line to the line
  Vector n;                 ///< across.points: output of the line to its constraint
};

/// A, B, N and E as sparse matrices: many states (10^5 and more), few constraints. Such scenes are solved through their
/// kernel (shifted sparse solves) or by stepping the state with one sparse factorization.
struct SparseDynamics {
  SparseMatrix A;       ///< m x m
  SparseMatrix B;       ///< m x n
  SparseMatrix N;       ///< n x m
  SparseMatrix E = {};  ///< m x m, or empty
};

/// Returns (zE - A)^{-1} R for its z; R is m x k.
using ShiftedSolve = std::function<ComplexMatrix(const ComplexMatrix& R)>;

/// Dynamics given by callbacks: matrix-free operators, solvers of a finite-element code, transforms. They are treated
/// like sparse dynamics, through the kernel N (zE - A)^{-1} B at the nodes of contours, or by stepping the state with
/// one prepared solve. `solve` passes exceptions of the callbacks on.
struct SuppliedDynamics {
  Index states = 0;  ///< m
  SparseMatrix B;    ///< m x n
  SparseMatrix N;    ///< n x m
  /// Prepares the solve for a shift z, for example by a factorization. Called for all nodes of the contours, a few
  /// hundred z in the right half-plane and around the spectrum, but not for their conjugates. If z is an eigenvalue,
  /// throw SingularShift or return values that are not finite.
  std::function<ShiftedSolve(Complex z)> shifted;
  /// E X for X m x k; empty: E = I.
  std::function<Matrix(const Matrix& X)> mass = {};
  /// Bound of the eigenvalues of E^{-1} A; if empty, estimated by shifted solves.
  std::optional<SpectralBound> bound = {};
  /// `shifted` and the functions it returns may be called from several threads at once. Otherwise all calls come from
  /// the thread that called `solve`.
  bool thread_safe = false;
};

using Dynamics = std::variant<DenseDynamics, KroneckerDynamics, SparseDynamics, SuppliedDynamics>;

Index states(const Dynamics&);
Index constraints(const Dynamics&);

/// Whether E is given.
bool has_mass(const Dynamics&);
/// E x.
Vector times_mass(const Dynamics&, const Vector& x);

/// A, B, N and E as dense matrices, for small scenes and as an oracle. Throws Error above 4096 states, and for supplied
/// dynamics.
DenseDynamics to_dense(const Dynamics&);

/// The Kronecker sum as sparse matrices, at any size.
SparseDynamics to_sparse(const KroneckerDynamics&);

/// B and N, whatever the kind of the dynamics.
SparseMatrix sparse_inputs(const Dynamics&);
SparseMatrix sparse_outputs(const Dynamics&);

/// The same A and E with other B and N. Throws Error for a Kronecker sum, whose B and N are those of its lines.
Dynamics with_inputs_and_outputs(Dynamics, const SparseMatrix& B, const SparseMatrix& N);

/// Whether A is known as a matrix or as a Kronecker sum, and not by callbacks alone.
bool has_matrices(const Dynamics&);

/// N x for one state.
Vector observe(const Dynamics&, const Vector& x);
/// |N| |x|: the rounding of N x is relative to this.
Vector observed_terms(const Dynamics&, const Vector& x);

}  // namespace bromwich

#pragma once
// What a user states:
//
//     x' = A x + B y + f(t),   0 <= y  ⊥  w = N x + M y + g(t) >= 0,   x(0) = x0,   0 <= t <= T.
//
// symbol  variable            shape    meaning
// A,B,N   Scene::dynamics     m x m, m x n, n x m   linear dynamics and how the constraints see and drive it
// M       Scene::M            n x n    complementarity matrix
// f, g    Scene::f, Scene::g  m or n, n              sources, functions of time
// x0, T   Scene::x0, Scene::T m, 1     initial state, final time (the unit of time is the user's)
//
// Instead of x(0) = x0 a scene may state E0 x(0) + ET x(T) = b, and rows of w = 0 with a free y_i (mixed problems).

#include "types.hpp"

#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

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

/// Tridiagonal matrix by its three diagonals; lower[0] and upper[n-1] are not used.
struct Tridiagonal {
  Vector lower, diagonal, upper;
};

/// The complementarity matrix M, dense or tridiagonal.
using LcpMatrix = std::variant<Matrix, Tridiagonal>;

/// What is known of M. `automatic` asks for a test (core/lcp/active_set_lcp.hpp).
enum class LcpClass { automatic, P, Z, PSD, unknown };

/// How f(t) enters: as an m-vector, as B phi(t) with an n-vector phi, or as F phi(t) with a k-vector phi. What is
/// stored and sampled is phi: a heat source that many cells share costs one number a time point.
enum class SourceEntry { state, through_B, through_F };

/// E0 x(0) + ET x(T) = b instead of x(0) = x0: initial values (I, 0), periodic (I, -I), separated or coupled ends.
struct BoundaryCondition {
  Matrix E0, ET;  ///< m x m
  Vector b;       ///< m
};

struct PortHamiltonian;  // core/port_hamiltonian.hpp

struct Scene {
  std::string name;
  Dynamics dynamics;
  LcpMatrix M;
  LcpClass lcp_class = LcpClass::automatic;
  TimeFunction f;  ///< m values, or the n or k values of phi, see f_entry; empty = 0
  SourceEntry f_entry = SourceEntry::state;
  SparseMatrix F;  ///< m x k with f_entry through_F, otherwise empty
  TimeFunction g;  ///< n values; empty = 0
  /// Times in [0, T] at which f or g may jump or have a kink, increasing; values there are taken one-sidedly. Empty
  /// where they are smooth.
  std::vector<double> breakpoints;
  bool breakpoints_are_all = false;  ///< f and g are known to be smooth elsewhere; no others are looked for
  Vector x0;                         ///< m; empty with a boundary condition
  std::optional<BoundaryCondition> boundary;
  std::vector<Index> free_rows;  ///< rows i with w_i = 0 and y_i of either sign, increasing
  /// The structure the dynamics were made from, where there is one; null otherwise. Such a scene may have no
  /// constraints (n = 0).
  std::shared_ptr<const PortHamiltonian> port;
  double T = 1;
  Index default_steps = 400;

  /// Exact solution where one is known: writes x (m) and y (n) at t.
  std::function<void(double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y)> exact;

  Index states() const;       ///< m
  Index constraints() const;  ///< n
  Index sources() const;      ///< length of what `f` writes: m, n or k

  /// Throws Error naming the first member whose size or value is wrong (shapes, NaN, T <= 0).
  void validate() const;
};

Index states(const Dynamics&);
Index constraints(const Dynamics&);
Index size(const LcpMatrix&);
Matrix to_dense(const LcpMatrix&);

/// A, B and N written out densely: for small scenes and as an oracle. Throws Error above 4096 states.
DenseDynamics to_dense(const Dynamics&);

/// The Kronecker sum as sparse matrices, at any size.
SparseDynamics to_sparse(const KroneckerDynamics&);

/// N x for one state.
Vector observe(const Dynamics&, const Vector& x);

/// M y for one vector.
Vector multiply(const LcpMatrix& M, const Vector& y);

}  // namespace bromwich

#pragma once
// Matrices that are the same stencil at all points of a grid: a I + Σ_d b_d (neighbours in direction d), zero outside.
// The sine modes of the grid diagonalise them.

#include "../numerics/face_basis.hpp"
#include "matrix.hpp"

#include <optional>
#include <vector>

namespace bromwich {

struct Stencil {
  std::vector<Index> extents;  ///< points of the directions of the grid, the fastest last
  double centre = 0;           ///< a
  std::vector<double> beside;  ///< b_d

  /// a + 2 Σ_d b_d cos(pi l_d / (n_d + 1)), l_d = 1..n_d, in the order of the grid.
  Vector eigenvalues() const;
  /// Spectral radius of I - M/a, from above: 2 Σ_d |b_d| cos(pi/(n_d + 1)) / a.
  double jacobi_radius() const;
  Stencil shifted(double D) const;  ///< of M + D I
};

/// M as a stencil on a grid with these extents, or nothing.
std::optional<Stencil> stencil_of(const LcpMatrix& M, const std::vector<Index>& extents);
std::optional<Stencil> stencil_of(const SparseMatrix& M, const std::vector<Index>& extents);
/// The same, if the modes of the grid diagonalise it: sine modes do, others only multiples of the identity.
std::optional<Stencil> stencil_in(const FaceBasis&, const LcpMatrix& M);
/// The eigenvalues of M in the order of the modes, or nothing where the modes do not diagonalise M.
std::optional<Vector> eigenvalues_in(const FaceBasis&, const LcpMatrix& M);

/// 2 / (1 + sqrt(1 - rho^2)), rho the Jacobi radius: the relaxation of successive over-relaxation for a symmetric
/// stencil. rho < 1.
double best_relaxation(const Stencil&);

/// The D of sweeps y <- LCP(M + D I, q + W_0 y - D y) with W_0 diagonal in sine modes, and their contraction
/// max_l |w0_l - D| / (M_l + D). M + D I stays positive definite.
struct InstantShift {
  double shift = 0, contraction = 0;
};
InstantShift instant_shift(const Vector& eigenvalues_of_M, const Vector& w0);

}  // namespace bromwich

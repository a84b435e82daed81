#pragma once

#include "linear_system.hpp"
#include "spectral_bound.hpp"

#include <functional>
#include <optional>

namespace bromwich {

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

std::shared_ptr<LinearSystem> linear_system(SuppliedDynamics);

}  // namespace bromwich

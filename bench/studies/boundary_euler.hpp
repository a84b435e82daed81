#pragma once
// Implicit Euler for scenes with boundary values, with the same solvers as the Galerkin method to which it is compared:
// all steps at once,
//
//     x_k = R (x_{k-1} + h B y_k + h f_k),   0 <= y_k ⊥ N x_k + M y_k + g_k >= 0,   E0 x_0 + ET x_J = b,
//
// R = (I - hA)^{-1}: exchange of active sets with exact two-point solves, damped Newton if they repeat. Dense dynamics.

#include "core/solve/solve.hpp"

namespace bromwich::app {

struct BoundaryEuler {
  bool solved = false;
  std::string reason;  ///< if not solved
  RowMatrix y;         ///< J x n, row k - 1 at t_k
  RowMatrix x;         ///< (J+1) x m
  Index iterations = 0;
  double residual = 0;  ///< max |min(y, w)| / max(1, |N x + g|)
  double seconds = 0;
};

BoundaryEuler solve_by_boundary_euler(const Scene&, Backend&, Index J);

}  // namespace bromwich::app

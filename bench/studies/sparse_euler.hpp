#pragma once
// Implicit Euler for sparse dynamics with contacts at states, written for the comparison with the solver: nothing in a
// step is done twice, and what does not change is done once.
//
//     (E/h - A) x_j = E x_{j-1}/h + F phi_j + B y_j,   0 <= y_j  ⊥  N x_j + M y_j + g_j >= 0
//
// One factorization L D L^T with the contact states last. A step is then one forward substitution, a problem of n rows
// with the Schur complement of the contact states, from the active set of the step before, and one backward
// substitution.

#include "core/scene/scene.hpp"

#include <functional>

namespace bromwich::app {

struct SparseEuler {
  RowMatrix y, w;               ///< (J+1) x n; row 0 is 0 and N x0 + g(0)
  double setup = 0, solve = 0;  ///< seconds
  std::size_t bytes = 0;
  Index factor_entries = 0;  ///< of L
  bool solved = false;
};

/// Precondition: sparse dynamics, E/h - A symmetric positive definite, every row of N and column of B has one entry, at
/// the same state. `stop`: polled in every step; true ends the run, which is then not solved.
SparseEuler solve_by_sparse_euler(const Scene&, Index steps, const std::function<bool()>& stop = {});

}  // namespace bromwich::app

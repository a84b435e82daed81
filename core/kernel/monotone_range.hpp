#pragma once
// Semidefinite M whose null space does not move the state (Remark 3.1 of the Laplace-inversion paper).
//
// symbol  meaning
// S       (M + M^T)/2, positive semidefinite
// U       orthonormal basis of the range of S, n x r; U0 of its null space
// S^+/2   pseudoinverse of the root of S
// D       diagonal, D_ii = M_ii^1/2, 1 where M_ii = 0
//
// Solutions y, y' of LCP(q, M) and LCP(q', M) fulfil (y - y')^T M (y - y') <= -(y - y')^T (q - q'): S y is unique. Let
// B U0 = 0. Then W_d U0 = 0 for all weights W_d = N (...) B, B y is unique, and the choice of the y of least norm has
// no effect on the state.
//
// 1. U0^T N = 0: the part of y that M leaves undetermined does not affect the dynamics. For q - q' in the range of S,
//    where all W_d y are,
//
//        |S^1/2 (y - y')| <= |S^+/2 (q - q')|,   q = r + Σ_d W_d y_{j-d}:
//
//    in this norm a sweep contracts by Σ_d e^{-s t_d} kappa_d, kappa_d = |S^+/2 W_d S^+/2|_2, as for M of class P. A
//    v >= 0 that proves a problem to have no feasible point has M^T v <= 0, so that v is in the null space of S and
//    v^T W_d = 0: all sweeps are feasible or none.
// 2. Otherwise N x may lead to problems without a solution. LCP(M, q) has one exactly if q is in a convex cone, and N x
//    does not leave it if it holds the columns of ±U0 U0^T N. Each of its q then has a solution y_S = -M_SS^{-1} q_S
//    with regular M_SS (Lemke's method on q + small positive numbers ends in one), so that along a line of q
//
//        |S^1/2 (y - y')| <= L |D^{-1} (q - q')|,   L = max_S |(S^1/2)_{.S} M_SS^{-1} D_SS|_2,
//
//    kappa_d = L |D^{-1} W_d S^+/2|_2. M + W_0 is not monotone: marching takes stages.

#include "../lcp/matrix.hpp"
#include "../seam/recurrence.hpp"
#include "discrete_problem.hpp"

#include <optional>
#include <string>

namespace bromwich {

struct MonotoneRange {
  Matrix basis;               ///< U
  Matrix unscaled;            ///< U diag(eigenvalues of S)^{-1/2}
  bool holds_outputs = true;  ///< N stays in the range, too: case 1
  Vector inverse_scale = {};  ///< diagonal of D^{-1}; case 2
  double lipschitz = 1;       ///< L; case 2, infinite if n > 12

  /// kappa of n x n weights: |S^+/2 W S^+/2|_2, or L |D^{-1} W S^+/2|_2.
  double contraction(const Matrix& W) const;
  /// U^T X U has a positive definite symmetric part, beyond rounding: then X_SS has no null space but that of M_SS.
  bool holds_definite(const Matrix& X) const;
};

/// Where M is of class PSD: the range of S, or the reason why sweeps cannot rely on it.
struct RangeOfM {
  std::optional<MonotoneRange> range;
  std::string why;  ///< "N x leaves the range of M + M^T", ...; empty with a range and for other classes
  bool moves_only_outputs = false;  ///< B stays in the range, N does not, and may leave the cone of case 2
};

/// n <= 1024.
RangeOfM range_of_M(const LcpMatrix& M, LcpClass, const SparseMatrix& B, const SparseMatrix& N);
RangeOfM range_of_M(const DiscreteProblem&);

}  // namespace bromwich

#pragma once
// Semidefinite M whose null space the dynamics do not see (Remark 3.1 of the Laplace-inversion paper).
//
// symbol  meaning
// S       (M + M^T)/2, positive semidefinite
// U       orthonormal basis of the range of S, n x r; U0 of its null space
// S^+/2   pseudoinverse of the root of S
//
// Solutions y, y' of LCP(q, M) and LCP(q', M) fulfil (y - y')^T M (y - y') <= -(y - y')^T (q - q'). If B U0 = 0 and
// U0^T N = 0, all weights W_d = N (...) B act from the range of S into it, and
//
//     |S^1/2 (y - y')| <= |S^+/2 (q - q')|   for q - q' in the range,   q = r + Σ_d W_d y_{j-d}:
//
// in this norm a sweep contracts by Σ_d e^{-s t_d} kappa_d, kappa_d = |S^+/2 W_d S^+/2|_2, as for M of class P. B y is
// unique and continuous in time, whatever solution y is; that of least norm is taken. A v >= 0 that proves a problem to
// have no feasible point lies in the null space of S (M^T v <= 0), and v^T W_d = 0: all sweeps are feasible or none.

#include "../lcp/matrix.hpp"
#include "../seam/recurrence.hpp"
#include "discrete_problem.hpp"

#include <optional>
#include <string>

namespace bromwich {

struct MonotoneRange {
  Matrix basis;     ///< U
  Matrix unscaled;  ///< U diag(eigenvalues of S)^{-1/2}

  /// |S^+/2 W S^+/2|_2 for n x n weights.
  double contraction(const Matrix& W) const;
  /// U^T X U has a positive definite symmetric part, beyond rounding: then X_SS has no null space but that of M_SS.
  bool holds_definite(const Matrix& X) const;
};

/// Where M is of class PSD: the range of S, or the reason why B or N leaves it.
struct RangeOfM {
  std::optional<MonotoneRange> range;
  std::string why;  ///< "N x leaves the range of M + M^T", ...; empty with a range and for other classes
  bool moves_only_outputs = false;  ///< B stays in the range, N does not
};

/// n <= 1024.
RangeOfM range_of_M(const LcpMatrix& M, LcpClass, const SparseMatrix& B, const SparseMatrix& N);
RangeOfM range_of_M(const DiscreteProblem&);

}  // namespace bromwich

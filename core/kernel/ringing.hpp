#pragma once
// Conditions for using continuous piecewise-linear y, and a test whether a solution violates them.
//
// On an active set S the discrete problem is M_SS y_j + Σ_d W_d,SS y_{j-d} = -q_j, with symbol M_SS + W^(zeta)_SS,
// W^(zeta) = Σ_d W_d zeta^d. Its root nearest to -1 decides whether y rings. For K = 1, W^ = h/2 (1 + zeta)/(1 - zeta):
// an error of y_0 is multiplied by (M - h/2)/(M + h/2) at every step. For K = t (contact force and position) the root
// passes through -1 at M = h^2/12 and y grows where M is smaller. With delta = 1,
//
//     M_delta = M + W^(-1) - delta W_0
//
// must have principal minors of the same signs as M + W_0. Then no root has crossed -1, and errors of y decay without
// alternating: M > h/2 for K = 1, M > h^2/4 for K = t; the step resolves what M damps.
//
// If the null space of a semidefinite M has no effect on the dynamics (monotone_range.hpp), M + W_0 and M_delta have to
// be definite on the range of M + M^T only. Where N sees it, each B y has an active set with a regular M_SS, and those
// minors are compared.

#include "../numerics/alternation.hpp"
#include "discrete_problem.hpp"
#include "monotone_range.hpp"
#include "recurrence.hpp"

namespace bromwich {

struct BasisChoice {
  bool continuous = true;
  bool rings = false;  ///< even with delta = 1/10: errors of y would alternate for many steps, or grow
  std::string reason;  ///< why not, if not continuous
  std::string refusal = "piecewise-linear y would ring";  ///< the behaviour of a continuous y
  bool only_in_sweeps = false;  ///< M, not M + W_0, selects the solution: marching has to take stages
};

/// For a step of the recurrence. Tests all active sets if n <= 12, otherwise sufficient conditions for P-matrices. A
/// Z-matrix (least elements) counts as safe unless its diagonal is zero.
BasisChoice choose_basis(const LcpMatrix& M, LcpClass, const DenseRecurrence&, const RangeOfM& = {});
/// The same from lag weights; their series is truncated.
BasisChoice choose_basis(const LcpMatrix& M, LcpClass, const LagTable&, const RangeOfM& = {});
/// The same from W_0 and W^(-1), n x n.
BasisChoice choose_basis(const LcpMatrix& M, LcpClass, const Matrix& w0, const Matrix& at_minus_one,
                         const RangeOfM& = {});
/// Without weights: M must be P or Z, or have its range.
BasisChoice choose_basis(const LcpMatrix& M, LcpClass, const RangeOfM& = {});

/// Rows over which alternating second differences are tested, and their smallest size relative to the largest value of
/// the column.
inline constexpr Index ringing_run = 16;
inline constexpr double ringing_part = 0.01;

/// Row at which a column of y begins to alternate from row to row over `ringing_run` rows with hardly any decay, or -1.
Index ringing_from(const RowMatrix& y);

}  // namespace bromwich

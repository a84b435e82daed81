#pragma once
// When continuous piecewise-linear y may be used, and whether a solution shows that it should not have been.
//
// On an active set S the discrete problem is M_SS y_j + Σ_d W_d,SS y_{j-d} = -q_j, with symbol M_SS + W^(zeta)_SS,
// W^(zeta) = Σ_d W_d zeta^d. Its root nearest to -1 decides whether y rings: for K = 1, W^ = h/2 (1 + zeta)/(1 - zeta),
// so a wrong y_0 comes back at every step with the factor (M - h/2)/(M + h/2); for K = t (a contact force and a
// position) the root passes through -1 at M = h^2/12 and y grows where M is smaller. With delta = 1,
//
//     M_delta = M + W^(-1) - delta W_0
//
// has to be of the kind that M + W_0 is: all principal minors of the same sign. Then no root has crossed -1, and what y
// forgets it forgets without changing sign: M > h/2 for K = 1, M > h^2/4 for K = t, the step resolves what M damps.

#include "../numerics/alternation.hpp"
#include "discrete_problem.hpp"
#include "recurrence.hpp"

namespace bromwich {

struct BasisChoice {
  bool continuous = true;
  bool rings = false;  ///< even with delta = 1/10: an error of y would alternate for many steps, or grow
  std::string reason;  ///< where it is not
};

/// For a step of the recurrence: all active sets where n <= 12; beyond, sufficient conditions for P-matrices. A
/// Z-matrix (least elements) is taken as safe unless its diagonal is zero.
BasisChoice choose_basis(const LcpMatrix& M, LcpClass, const DenseRecurrence&);
/// The same from lag weights, as far as they go.
BasisChoice choose_basis(const LcpMatrix& M, LcpClass, const LagTable&);
/// Without weights: M has to be P or Z.
BasisChoice choose_basis(const LcpMatrix& M, LcpClass);

/// Second differences that alternate are looked at over so many rows, where they are larger than so much of the largest
/// value of their column.
inline constexpr Index ringing_run = 16;
inline constexpr double ringing_part = 0.01;

/// Finds a column of y that alternates from one row to the next over `ringing_run` rows with hardly any decay: the row
/// where that begins, or -1.
Index ringing_from(const RowMatrix& y);

}  // namespace bromwich

#pragma once
// When a vector counts as a solution of LCP(q, M), and which scaling makes the rows comparable.
//
// With positive diagonal R and C, y solves LCP(q, M) exactly when C^{-1} y solves LCP(R q, R M C); the active sets, P
// and Z stay what they are. Powers of two, so that scaling rounds nothing.

#include "../numerics/equilibration.hpp"
#include "matrix.hpp"

#include <vector>

namespace bromwich {

/// R and C with the largest entry of every row and column of R M C between about 1/2 and 2; 1 for zero rows, columns.
Equilibration equilibrate(const LcpMatrix&);
Equilibration equilibrate(const Tridiagonal&);

/// M + D I.
Tridiagonal plus_identity(Tridiagonal M, double D);

/// R M C.
Tridiagonal scaled(const Tridiagonal&, const Equilibration&);
LcpMatrix scaled(const LcpMatrix&, const Equilibration&);

/// y >= 0 and min(y_i, w_i) = 0 up to rounding: a w_i that should vanish, or should not be negative, is judged by
/// |q_i| + Σ_j |m_ij| y_j, the terms it is summed from, and by the largest q. A y so large that this rounding hides q
/// is no solution (a singular M_SS gives such), unless that row's w is positive anyway. For rows of comparable scale.
bool is_solution(const Matrix& M, const Vector& q, const Vector& y);

/// The solution y of a monotone (PSD) problem is the only one for certain: M_SS is well conditioned and no index has
/// both y_i and w_i near rounding. Then y is isolated, and the set of solutions is convex.
bool is_certainly_unique(const Matrix& M, const Vector& q, const Vector& y);
bool is_certainly_unique(const Tridiagonal& M, const Vector& q, const Vector& y);

/// {i : y_i > 0}.
std::vector<Index> support_of(const Eigen::Ref<const Vector>& y);

/// {i < n : bit i of `set` is one}: the active set of that number, for loops over all of them.
std::vector<Index> members(unsigned set, Index n);

}  // namespace bromwich

#pragma once
// The criterion that accepts a vector as a solution of LCP(q, M), and the scaling that makes the rows comparable.
//
// With positive diagonal R and C, y solves LCP(q, M) if and only if C^{-1} y solves LCP(R q, R M C). Active sets and
// the classes P and Z do not change. R and C are powers of two, so scaling causes no rounding.

#include "../numerics/equilibration.hpp"
#include "matrix.hpp"

#include <vector>

namespace bromwich {

/// R and C with the largest entry of every row and column of R M C between about 1/2 and 2; 1 for zero rows, columns.
Equilibration equilibrate(const LcpMatrix&);
Equilibration equilibrate(const Tridiagonal&);
Equilibration equilibrate(const SparseMatrix&);
Equilibration equilibrate(const SparseLcpMatrix&);

/// M + D I.
Tridiagonal plus_identity(Tridiagonal M, double D);

/// R M C.
Tridiagonal scaled(const Tridiagonal&, const Equilibration&);
SparseLcpMatrix scaled(const SparseLcpMatrix&, const Equilibration&);
LcpMatrix scaled(const LcpMatrix&, const Equilibration&);

/// w = M y + q, n entries, and the sizes of its terms, |q_i| + Σ_j |m_ij| y_j. Evaluated again in the same memory.
struct SlackTerms {
  Vector w, terms;
  /// y >= 0, n entries.
  void evaluate(const Matrix& M, const Vector& q, const Vector& y);
};

/// y >= 0 and min(y_i, w_i) = 0 up to rounding. A w_i that should vanish, or should not be negative, is compared with
/// the rounding of its terms, |q_i| + Σ_j |m_ij| y_j, and of the largest q. If y is so large that this rounding exceeds
/// q (as for a singular M_SS), y is not a solution, unless the w of that row is clearly positive. Precondition: rows of
/// comparable scale.
bool is_solution(const Matrix& M, const Vector& q, const Vector& y);
/// The same for y >= 0 whose slack is known.
bool is_solution(const SlackTerms&, const Vector& q, const Vector& y);

/// The solution y of a monotone (PSD) problem is certainly unique: M_SS is well conditioned and no index has both y_i
/// and w_i near rounding. Then y is isolated, and the set of solutions is convex.
bool is_certainly_unique(const Matrix& M, const Vector& q, const Vector& y);
bool is_certainly_unique(const Tridiagonal& M, const Vector& q, const Vector& y);
/// Its two parts: y alone, and M_SS alone, which all y with the active set S share.
bool is_clear_of_rounding(const Matrix& M, const SlackTerms&, const Vector& y);
bool is_well_conditioned(const Matrix& M, const std::vector<Index>& S);

/// {i : y_i > 0}.
std::vector<Index> support_of(const Eigen::Ref<const Vector>& y);

/// {i < n : bit i of `set` is one}: the active set of that number, for loops over all of them.
std::vector<Index> members(unsigned set, Index n);

}  // namespace bromwich

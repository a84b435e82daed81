#pragma once
// Enumeration of all active sets of a small complementarity problem: the last fallback, which misses no solution.

#include "matrix.hpp"

#include <functional>
#include <optional>
#include <vector>

namespace bromwich {

inline constexpr Index largest_enumeration = 12;

/// x >= 0 that minimises ||A x - b||_2 (Lawson and Hanson, Solving Least Squares Problems, chapter 23).
Vector nonnegative_least_squares(const Matrix& A, const Vector& b);

/// The first solution of LCP(q, M) over the active sets that `admissible` accepts, in the order of their binary
/// numbers. Branches of sets whose columns do not reach q are passed over. If M_SS is singular, nonnegative least
/// squares search y_S >= 0 and w >= 0 with M_SS y_S = -q_S and w = M y + q off S. Precondition: n <= 12, rows and
/// columns of comparable scale.
std::optional<Vector> solve_by_enumeration(const Matrix& M, const Vector& q,
                                           const std::function<bool(const std::vector<Index>& S)>& admissible);

}  // namespace bromwich

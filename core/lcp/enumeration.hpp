#pragma once
// All active sets of a small complementarity problem, one after the other: the last resort, which misses no solution.

#include "matrix.hpp"

#include <functional>
#include <optional>
#include <vector>

namespace bromwich {

inline constexpr Index largest_enumeration = 12;

/// x >= 0 that minimises ||A x - b||_2 (Lawson and Hanson, Solving Least Squares Problems, chapter 23).
Vector nonnegative_least_squares(const Matrix& A, const Vector& b);

/// The first solution of LCP(q, M) over the active sets that `admissible` lets pass, in order of the sets' binary
/// numbers. Where M_SS is singular, y_S >= 0 and w >= 0 with M_SS y_S = -q_S, w = M y + q off S are looked for by
/// nonnegative least squares. Precondition: n <= 12, rows and columns of comparable scale.
std::optional<Vector> solve_by_enumeration(const Matrix& M, const Vector& q,
                                           const std::function<bool(const std::vector<Index>& S)>& admissible);

}  // namespace bromwich

#pragma once
// Whether a small complementarity problem has more than one solution.

#include "matrix.hpp"

#include <optional>

namespace bromwich {

inline constexpr Index largest_searched = 8;  ///< constraints: all active sets
inline constexpr Index largest_moved = 48;    ///< likewise: solutions next to one, by factorizations for each

/// The nearest solution of LCP(q, M) that differs from the solution y by more than 1e-6 of the largest entry of both.
/// Empty if there is none. On active sets with a singular M_SS, and on all with n > 8, only directions in which y
/// itself can move are searched. `at_corners`: also those in which a y_i = 0 with w_i = 0 grows, such as both voltages
/// of an open switch.
std::optional<Vector> another_solution(const Matrix& M, const Vector& q, const Vector& y, bool at_corners = false);

}  // namespace bromwich

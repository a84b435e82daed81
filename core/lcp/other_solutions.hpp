#pragma once
// Whether a small complementarity problem has more than one solution.

#include "matrix.hpp"

#include <optional>

namespace bromwich {

inline constexpr Index largest_searched = 8;

/// The nearest solution of LCP(q, M) that differs from the solution y by more than 1e-6 of the largest entry of both.
/// Empty if there is none, or n > 8. On active sets with a singular M_SS, only directions in which y itself can move
/// are searched.
std::optional<Vector> another_solution(const Matrix& M, const Vector& q, const Vector& y);

}  // namespace bromwich

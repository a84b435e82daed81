#pragma once
// Lemke's method for the oracle, independent of core/lcp.

#include "core/base/types.hpp"

#include <optional>
#include <vector>

namespace bromwich::oracle {

/// Which y_i are basic in a complementary basis with y >= 0, w = M y + q >= 0; none if the method ends on a ray and,
/// for n <= 15, no set of all 2^n solves the problem. Rows and columns of any size: they are scaled first. `first`:
/// returned if it is such a basis.
std::optional<std::vector<char>> complementary_basis(const Matrix& M, const Vector& q,
                                                     const std::vector<char>& first = {});

/// y of a basis.
Vector basic_solution(const Matrix& M, const Vector& q, const std::vector<char>& basis);

}  // namespace bromwich::oracle

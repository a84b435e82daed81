#pragma once
// The complementarity matrix M and its class.

#include "../base/types.hpp"

#include <variant>

namespace bromwich {

/// Tridiagonal matrix by its three diagonals; lower[0] and upper[n-1] are not used.
struct Tridiagonal {
  Vector lower, diagonal, upper;
};

/// The complementarity matrix M, dense or tridiagonal.
using LcpMatrix = std::variant<Matrix, Tridiagonal>;

/// The class of M as stated by the user. `automatic`: it is tested (core/lcp/lcp_class.hpp).
enum class LcpClass { automatic, P, Z, PSD, unknown };

Index size(const LcpMatrix&);
Matrix to_dense(const LcpMatrix&);

/// M y for one vector.
Vector multiply(const LcpMatrix& M, const Vector& y);

}  // namespace bromwich

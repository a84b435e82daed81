#pragma once
// The complementarity matrix M.

#include "types.hpp"

#include <memory>
#include <variant>

namespace bromwich {

/// The class of M as stated by the user. `automatic`: it is tested.
enum class LcpClass { automatic, P, Z, PSD, unknown };

/// Tridiagonal matrix by its three diagonals; lower[0] and upper[n-1] are not used.
struct Tridiagonal {
  Vector lower, diagonal, upper;
};

/// A sparse M. Copies share the entries.
struct SparseLcpMatrix {
  explicit SparseLcpMatrix(SparseMatrix);  ///< compresses it
  std::shared_ptr<const SparseMatrix> entries;
};

/// The complementarity matrix M: dense, tridiagonal, or sparse.
using LcpMatrix = std::variant<Matrix, Tridiagonal, SparseLcpMatrix>;

}  // namespace bromwich

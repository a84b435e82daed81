#pragma once
// The complementarity matrix M.

#include "../base/types.hpp"
#include "class_traits.hpp"

#include <memory>
#include <variant>

namespace bromwich {

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

/// The entries of a sparse M; null if M is dense or tridiagonal.
inline const SparseMatrix* sparse_of(const LcpMatrix& M) {
  const auto* sparse = std::get_if<SparseLcpMatrix>(&M);
  return sparse ? sparse->entries.get() : nullptr;
}

/// use(i, j, entry) for all entries on the three diagonals; of a matrix that is not const, entries may be changed.
template <class Bands, class Use>
void each_entry(Bands& t, const Use& use) {
  const Index n = t.diagonal.size();
  for (Index i = 0; i < n; ++i) {
    use(i, i, t.diagonal[i]);
    if (i > 0) use(i, i - 1, t.lower[i]);
    if (i + 1 < n) use(i, i + 1, t.upper[i]);
  }
}

Index size(const LcpMatrix&);
Vector diagonal(const LcpMatrix&);
Matrix to_dense(const LcpMatrix&);

/// M y for one vector.
Vector multiply(const LcpMatrix& M, const Vector& y);

}  // namespace bromwich

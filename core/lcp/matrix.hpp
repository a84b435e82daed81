#pragma once
// Operations on the complementarity matrix M.

#include "../base/types.hpp"
#include "bromwich/lcp.hpp"
#include "class_traits.hpp"

#include <memory>
#include <variant>

namespace bromwich {

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

#pragma once

#include "../base/threads.hpp"
#include "../base/types.hpp"

namespace bromwich::multifrontal {

/// N (z_p E - A)^{-1} B for all nodes z_p, a row for each; E may be empty. Throws SingularShift if a node is an
/// eigenvalue.
ComplexMatrix sparse_shifted_solves(const SparseMatrix& A, const SparseMatrix& E, const SparseMatrix& B,
                                    const SparseMatrix& N, const ComplexVector& nodes, const HostThreads&);

}  // namespace bromwich::multifrontal

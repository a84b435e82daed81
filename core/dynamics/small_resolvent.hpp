#pragma once

#include "../base/types.hpp"

namespace bromwich {

/// N (z_p I - A)^{-1} B for all nodes z_p, row p with the n k entries of one matrix row by row. For small A: m x m, B:
/// m x k, N: n x m. Not finite where a pivot is zero.
ComplexMatrix small_resolvent(const Matrix& A, const Matrix& B, const Matrix& N, const ComplexVector& nodes);

}  // namespace bromwich

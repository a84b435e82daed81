#pragma once
// Sparse rows, and linear equations in block triangular form.

#include "core/base/types.hpp"

#include <Eigen/SparseCore>

namespace bromwich::circuits {

using Rows = Eigen::SparseMatrix<double, Eigen::RowMajor>;

/// count columns from `first` on.
Rows columns(const Rows&, Index first, Index count);

/// [a, b], and b below a.
Rows beside(const Rows& a, const Rows& b);
Rows below(const Rows& a, const Rows& b);

struct BlockSolution {
  Rows Z;               ///< P Z = Q
  Index singular = -1;  ///< an unknown that the equations do not determine, otherwise -1
};

/// Equations and unknowns are ordered so that P is block triangular (a maximum matching, and the strong components of
/// what determines what: Duff, Reid, ACM Trans. Math. Softw. 4, 1978), and each block is eliminated alone. Where blocks
/// are small, Z is as sparse as what determines each unknown: a ladder takes time and memory proportional to its
/// length.
BlockSolution solve_in_blocks(const Rows& P, const Rows& Q);

}  // namespace bromwich::circuits

#pragma once
// Symbolic part of a multifrontal elimination of zI - A with A sparse, the same for all shifts z.
//
// The bordered matrix [zI - A, B; -N, 0] is reduced to its last block, which is then N (zI - A)^{-1} B. No factor is
// stored and no solve follows. Columns with the same structure are eliminated together in a dense *front*
//
//                 pivots   rest   inputs
//     pivots   [    P       U       U    ]      rest: rows and columns touched by the pivots and eliminated later,
//     rest     [    L       C       C    ]      inputs, outputs: columns of B and rows of N that have reached the
//     outputs  [    L       C     result ]      front, which are few for sparse B and N.
//
// The update matrix C stays on a stack until the front of its parent is assembled (Duff, Reid, ACM TOMS 9, 1983; Liu,
// SIAM Review 34, 1992). Order: approximate minimum degree or nested dissection, whichever needs fewer products, then a
// postorder of the elimination tree.

#include "../base/types.hpp"

#include <vector>

namespace bromwich {

struct Front {
  Index first = 0, pivots = 0;       ///< eliminates the positions first .. first+pivots-1 of the order
  std::vector<int> rest;             ///< positions, increasing
  std::vector<int> inputs, outputs;  ///< columns of B and rows of N, increasing
  Index children = 0;                ///< their update matrices are on top of the stack

  Index rows() const { return pivots + Index(rest.size() + outputs.size()); }
  Index cols() const { return pivots + Index(rest.size() + inputs.size()); }
  /// Size of the update matrix on the stack: all except the pivots and the block of outputs and inputs.
  Index remainder() const { return rest.empty() ? 0 : (rows() - pivots) * (cols() - pivots); }
};

struct Elimination {
  std::vector<int> order;     ///< position -> row and column of A
  std::vector<Front> fronts;  ///< children before parents
  Index largest_front = 0;    ///< entries
  Index largest_stack = 0;    ///< entries
  double products = 0;        ///< multiplications and additions of one elimination

  Index entries() const { return largest_front + largest_stack; }  ///< memory of one elimination
};

/// `dense_inputs`: number of full columns after those of B.
Elimination analyse(const SparseMatrix& A, const SparseMatrix& B, const SparseMatrix& N, Index dense_inputs);

}  // namespace bromwich

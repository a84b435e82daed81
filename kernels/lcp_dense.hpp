#pragma once
// The kernels of complementarity problems with one dense matrix of more than eight rows. All work on R M C, whose rows
// and columns have comparable size (core/lcp/solution.hpp).

#include "kernels/lcp_batch.hpp"

namespace bromwich::cuda {

struct DenseProblems {
  const double *M, *row_scale, *column_scale;  ///< R M C by rows; R; C
  int n;
  bool least;  ///< accept only active sets with positive pivots
};

/// Rows that a kernel leaves to the next one: rows[0 .. *count - 1]. Null: none were left out.
struct LeftRows {
  int *rows, *count;
};

inline constexpr Index largest_in_lanes = 64, largest_in_blocks = 1024;

/// Newton sweeps of rows first .. rows - 1 by parts of a warp, n <= 64. The batch ends with the kernel that takes
/// `left`.
void solve_in_lanes(const Device&, const LcpArrays&, const DenseProblems&, int first, int rows, LeftRows left,
                    const OutcomeTarget&);

/// One block for each problem, n <= 1024.
class BlockLcp {
 public:
  /// `largest` > 0: the largest entry of a semidefinite M, of whose solutions the one of least norm is taken.
  BlockLcp(const Device&, Index n, Index rows, double largest);

  /// Rows first .. rows - 1, or those of `left`.
  void solve(const LcpArrays&, const DenseProblems&, int first, int rows, LeftRows left, const OutcomeTarget&);
  std::size_t bytes() const { return slabs_.bytes(); }

 private:
  const Device& device_;
  double eps_;  ///< first shift of a semidefinite M; 0: none
  int room_;    ///< values in shared memory for M_SS; larger ones are in a slab of the block
  unsigned blocks_, threads_;
  std::size_t shared_;
  Memory<double> slabs_;
};

}  // namespace bromwich::cuda

#pragma once
// The kernel of dynamics that are known by shifted solves, sparse or supplied: everything that A contributes comes from
// one batch of them,
//
//     [N; I_c] (z_p E - A)^{-1} [B F E x0],   I_c the rows of the identity for the state components asked for,
//
// at the nodes of all windows of lags. The first n rows are what the constraints see, the others what the user sees.

#include "discrete_problem.hpp"
#include "kernel.hpp"

namespace bromwich {

struct SparseKernel {
  LagTable weights;  ///< W_d, S_d of y as the constraints see it: n x n
  RowMatrix free;    ///< (J+1) x n: N e^{A t_j} x0 + response to f; row 0 = N x0

  LagTable seen;        ///< of y as the components see it: c x n
  RowMatrix seen_free;  ///< (J+1) x c

  std::string description;  ///< contour, nodes, spectrum
  double error = 0;         ///< deviation of the weights from those of another contour, relative to the largest
  std::size_t bytes = 0;
};

/// Starts with the sector estimated for the spectrum (the contour shifted to the right of a positive abscissa) and
/// moves to wider ones until the kernel agrees with itself: neighbouring windows where they meet, and another contour
/// for the smallest and the largest times. An eigenvalue that the contour of one window misses is inside that of an
/// earlier one, so that the two disagree. Empty where no contour is good to `accepted_contour_error`: an oscillating or
/// strongly non-normal A. Throws Error where f is given per state and there are too many states.
std::optional<SparseKernel> sparse_kernel(const DiscreteProblem&, const std::vector<Index>& components);

/// The components that a kernel was made for, from its weights: (J+1) x c.
RowMatrix sparse_states(const DiscreteProblem&, const SparseKernel&, const RowMatrix& y);

inline constexpr double accepted_contour_error = 1e-9;

/// Bytes that sparse_kernel needs at most, up to small tables, for so many columns next to each other in [B F E x0] and
/// rows in [N; I_c]. Found by the symbolic analysis of A, B and N, which is exact for the elimination, with the columns
/// after those of B taken as dense and the rows after those of N as absent: components in far corners add a few
/// percent.
double predicted_sparse_bytes(const SparseDynamics&, Index J, Index n_inputs, Index n_outputs, int threads);

}  // namespace bromwich

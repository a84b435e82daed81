#pragma once
// The kernel of dynamics known by shifted solves, sparse or supplied. One batch of solves gives everything that depends
// on A,
//
//     [N; I_c] (z_p E - A)^{-1} [B F E x0],   I_c the rows of the identity for the requested components of the state,
//
// at the nodes of all windows of lags. The first n rows are outputs for the constraints, the others for the user.

#include "../dynamics/spectrum.hpp"
#include "discrete_problem.hpp"
#include "kernel.hpp"

#include <vector>

namespace bromwich {

struct SparseKernel {
  LagTable weights;  ///< W_d, S_d from y to the constraints: n x n
  RowMatrix free;    ///< (J+1) x n: N e^{A t_j} x0 + response to f; row 0 = N x0

  LagTable seen;        ///< from y to the components: c x n
  RowMatrix seen_free;  ///< (J+1) x c

  std::string description;  ///< contour, nodes, spectrum
  double error = 0;         ///< difference to the weights of another contour, relative to the largest weight
  std::size_t bytes = 0;
};

/// Starts with the sector estimated for the spectrum (the contour is shifted to the right of a positive abscissa) and
/// widens it until the kernel is consistent. Neighbouring windows then agree where they meet, and another contour
/// agrees for the smallest and the largest times. An eigenvalue missed by the contour of one window lies inside that of
/// an earlier one, so the two disagree. Empty if no contour reaches `accepted_contour_error`: an oscillating or
/// strongly non-normal A. Throws Error if f is given per state and there are too many states.
std::optional<SparseKernel> sparse_kernel(const DiscreteProblem&, const std::vector<Index>& components);

/// The components for which the kernel was made, from its weights: (J+1) x c.
RowMatrix sparse_states(const DiscreteProblem&, const SparseKernel&, const RowMatrix& y);

inline constexpr double accepted_contour_error = 1e-9;

/// Contours to try in this order: half angles of their sectors, the narrowest that holds the spectrum first, and the
/// shift to the right of a positive abscissa.
struct ContourChoices {
  double shift = 0;
  std::vector<double> half_angles;
};
ContourChoices contours_to_try(const Spectrum&, double T);

/// Bytes of the elimination alone, and an upper bound, up to small tables, of the bytes needed by sparse_kernel for so
/// many columns of [B F E x0] and rows of [N; I_c]. From the symbolic analysis of A, B and N, which is exact for the
/// elimination; columns after those of B count as dense, rows after those of N as absent. Components far from the
/// constraints add a few percent.
double predicted_elimination_bytes(const SparseDynamics&, Index n_inputs, int threads);
double predicted_sparse_bytes(const SparseDynamics&, Index J, Index n_inputs, Index n_outputs, int threads);

}  // namespace bromwich

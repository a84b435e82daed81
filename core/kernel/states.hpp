#pragma once
// The state x, a by-product: computed only where it is asked for.

#include "discrete_problem.hpp"
#include "sparse_kernel.hpp"

namespace bromwich {

/// All time points, chosen components: (J+1) x components.size(), row 0 = x0. The state is stepped (in sine modes for
/// the Kronecker sum), O(J m) operations and, for the grid points asked for, O(J m) more per position on the lines.
/// `defects`: of a result whose steps were taken in parts.
RowMatrix state_components(const DiscreteProblem&, Rule, const RowMatrix& y, const std::vector<Index>& components,
                           const StepDefects* defects = nullptr);

/// The components that a sparse kernel was made for, from its weights: (J+1) x c.
RowMatrix sparse_states(const DiscreteProblem&, const SparseKernel&, const RowMatrix& y);

/// Chosen time points, all components: m x rows.size(). With u = y (+ phi),
///
///     x_j = e^{A t_j} x0 + Σ_windows Σ_p (z_p I - A)^{-1} B [ Σ_d c_p F_d(z_p) u_{j-d} ],
///
/// the shifted solves of a few contours a time point, whatever j (Kronecker sum); dense dynamics are stepped; sparse
/// ones are not offered.
Matrix states_at_rows(const DiscreteProblem&, const RowMatrix& y, const std::vector<Index>& rows,
                      const StepDefects* defects = nullptr);

}  // namespace bromwich

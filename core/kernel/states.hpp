#pragma once
// The state x behind a solution y. The methods do without it; it is computed on request.

#include "discrete_problem.hpp"

namespace bromwich {

/// Chosen time points, all components: m x rows.size(). With u = y (+ phi),
///
///     x_j = e^{A t_j} x0 + Σ_windows Σ_p (z_p I - A)^{-1} B [ Σ_d c_p F_d(z_p) u_{j-d} ],
///
/// the shifted solves of a few contours a time point, whatever j (Kronecker sum); dense dynamics are stepped; sparse
/// ones are not offered.
Matrix states_at_rows(const DiscreteProblem&, const RowMatrix& y, const std::vector<Index>& rows,
                      const StepDefects* defects = nullptr);

}  // namespace bromwich

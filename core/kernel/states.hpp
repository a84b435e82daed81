#pragma once
// The state x of a solution y. Methods do not need it; it is computed on request.

#include "discrete_problem.hpp"

namespace bromwich {

/// All components at chosen time points: m x rows.size(). With u = y (+ phi),
///
///     x_j = e^{A t_j} x0 + Σ_windows Σ_p (z_p I - A)^{-1} B [ Σ_d c_p F_d(z_p) u_{j-d} ],
///
/// which takes the shifted solves of a few contours per time point, independent of j (Kronecker sum). Dense dynamics
/// are stepped; sparse dynamics are not supported.
Matrix states_at_rows(const DiscreteProblem&, const RowMatrix& y, const std::vector<Index>& rows,
                      const StepDefects* defects = nullptr);

}  // namespace bromwich

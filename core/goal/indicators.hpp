#pragma once
// Contributions of the cells to the error of a quantity of interest. x_h is transferred to the grid with every cell
// halved; its residuals in the two half steps of a cell are weighted with the adjoint.

#include "../seam/backend.hpp"
#include "options.hpp"

namespace bromwich {

/// The indicators, M values. With X_f the solution on the halved grid, P x_h the reconstruction there and
/// S z = R^T z + I'(P x_h) its adjoint, Σ z_i^T r_i = I'(P x_h) (X_f - P x_h). The sum of the indicators is
/// -secant/(1 - 2^-p) times that (p the order of the reconstruction) if `weights` is global and the adjoint exact,
/// otherwise an approximation of it.
/// `l` (M+1 x m) is the adjoint on the grid of `path`; not used with global weights.
Vector goal_indicators(const Trajectory& path, Backend&, const QuantityOfInterest&, CellWeights, const RowMatrix& l,
                       const AdjointChoice&);

/// z_i^T r_i summed over the two half steps of every cell: of the chain `fine` with the right-hand side d on the halved
/// grid, at x, with z from the gradient of the quantity there. M values.
Vector weighted_residual(Backend&, const StepChainProblem& fine, const RowMatrix& d, const RowMatrix& x,
                         const RowMatrix& gradient, CellWeights, const RowMatrix& l, const AdjointChoice&);
/// The factor from those sums to indicators.
double indicator_scale(StepScheme, const QuantityOfInterest&);

/// Adds to the indicators what the quadrature of an integral on the cells misses: its change from x_h to P x_h, over
/// 1 - 2^-p.
void add_quadrature_errors(const QuantityOfInterest&, const Trajectory& coarse, const Trajectory& fine,
                           Vector& indicators);

}  // namespace bromwich

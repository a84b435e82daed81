#pragma once
// How much each cell contributes to the error of a quantity of interest: the residual that x_h, carried to the grid
// with every cell halved, leaves in the two half steps, weighted with the adjoint.

#include "../seam/backend.hpp"
#include "options.hpp"

namespace bromwich {

/// With X_f the solution on the halved grid, P x_h the reconstruction there and S z = R^T z + I'(P x_h) its adjoint,
/// Σ z_i^T r_i = I'(P x_h) (X_f - P x_h): the sum of what this returns is -secant/(1 - 2^-p) times that (p the order of
/// the reconstruction), where `weights` is global and the adjoint exact; otherwise near to it. M values.
/// `l` (M+1 x m) is the adjoint on the grid of `path`; not used with global weights.
Vector goal_indicators(const Trajectory& path, Backend&, const QuantityOfInterest&, CellWeights, const RowMatrix& l,
                       const AdjointChoice&);

/// z_i^T r_i summed over the two half steps of every cell: of the chain `fine` with the right-hand side d on the halved
/// grid, at x, with z from the gradient of the quantity there. M values.
Vector weighted_residual(Backend&, const StepChainProblem& fine, const RowMatrix& d, const RowMatrix& x,
                         const RowMatrix& gradient, CellWeights, const RowMatrix& l, const AdjointChoice&);
/// What those sums are multiplied with to become indicators.
double indicator_scale(StepScheme, const QuantityOfInterest&);

}  // namespace bromwich

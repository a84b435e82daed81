#pragma once
// Prediction of the memory that method goal needs.

#include "reconstruction.hpp"

namespace bromwich {

struct GoalCost {
  double arrays = 0;  ///< bytes: states, adjoints, gradients and residuals of a grid and of the halved one
  double steps = 0;   ///< bytes: the matrices and factors of all step sizes of both
  double bytes() const { return arrays + steps; }
};

/// Within a factor of about two, without products of steps (doubling, scan): these are limited to the remaining memory.
GoalCost predicted_goal_cost(const PortSystem&, StepScheme, Index constraints, Index cells, Index sizes);

/// The largest number of cells, with `sizes` step sizes, that fits into `limit` bytes; 0 if not even one does.
Index most_goal_cells(const PortSystem&, StepScheme, Index constraints, Index sizes, double limit);

/// Throws Error("steps", ...) if the cost is above the limit; 0 = no limit.
void refuse_goal_beyond(double limit, const GoalCost&, const PortSystem&, Index cells, Index sizes);

}  // namespace bromwich

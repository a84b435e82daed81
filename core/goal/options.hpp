#pragma once
// Options and report of method goal.

#include "quantities.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// The adjoint with which the residual of a cell is weighted.
enum class CellWeights {
  local,         ///< that of the grid with all cells halved, solved inside each cell from the coarse adjoint at its end
  interpolated,  ///< the coarse adjoint, linear from cell to cell (the paper)
  global,        ///< that of the grid with all cells halved, solved over all of it: twice the work
};
const char* to_string(CellWeights);

/// Refinement of the cells with the largest contributions to the error.
enum class Refinement {
  bisection,  ///< they are halved
  division,   ///< [0, T] is divided into equal blocks, a quarter as many as cells, and each block into equal cells
              ///< according to its share of the error: twice as many cells as before in total, of few sizes. The
              ///< requested number of cells is divided once more
};
const char* to_string(Refinement);

/// Used with Options: `steps` is the final number of cells (default: that of the scene; no limit if only cycles or a
/// tolerance are given), `tolerance` the estimated absolute error of the quantity at which the cycle ends.
struct GoalOptions {
  StepScheme scheme = StepScheme::euler;
  std::shared_ptr<const QuantityOfInterest> quantity;  ///< null: local_balance()
  AdjointChoice adjoint;
  CellWeights weights = CellWeights::local;
  Refinement refinement = Refinement::bisection;
  /// For bisection: share of the estimated error whose cells are halved (Doerfler), in (0, 1]; 0: economical_cells
  /// chooses.
  double marking = 0;
  Index first_cells = 20;  ///< of the first grid, equal except at the jumps of the input
  Index cycles = 0;        ///< refinements; 0 = as many as steps or tolerance need
  Vector first_grid;       ///< instead of first_cells: times 0 to T
};

/// One grid of the cycle.
struct GoalCycle {
  Index cells = 0;
  Index sizes = 0;      ///< distinct step sizes
  double quantity = 0;  ///< I(x_h)
  double estimate = 0;  ///< of I(x_h) - I(x): sum of the indicators
  double absolute = 0;  ///< sum of their absolute values
  /// estimate / (I(x_h) - I(x)), if I(x) is known, the difference is above the rounding of the estimate and of I(x_h),
  /// and the grid is not blind.
  std::optional<double> effectivity;
  double seconds = 0;
};

/// The part of a Result that method goal adds.
struct GoalReport {
  std::string quantity, scheme, adjoint, weights;
  std::optional<double> exact;
  std::vector<GoalCycle> history;  ///< the grid of the result is the last
  EnergyBalance balance;           ///< of the result
  PowerBalance power;
};

/// Evaluation of the solution on one grid.
struct GoalEvaluation {
  RowMatrix x;  ///< (M+1) x m
  double quantity = 0;
  Vector indicators;  ///< M, with signs: contribution of cell i to I(x_h) - I(x)
  Index sizes = 0;
  std::string elsewhere;  ///< work done on another machine than the backend's (StepChain::elsewhere)
  double rounding = 0;    ///< rounding error of the quantity
  bool blind = false;     ///< the input nearly vanishes at all points that the steps use, and not in between
};

}  // namespace bromwich

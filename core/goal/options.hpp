#pragma once
// What a user may ask of method goal, and what it reports.

#include "quantities.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// With which adjoint the residual of a cell is weighted.
enum class CellWeights {
  local,         ///< that of the grid with all cells halved, solved inside each cell from the coarse adjoint at its end
  interpolated,  ///< the coarse adjoint, linear from cell to cell (the paper)
  global,        ///< that of the grid with all cells halved, solved over all of it: twice the work
};
const char* to_string(CellWeights);

/// How the cells that carry most of the error are made smaller.
enum class Refinement {
  bisection,  ///< they are halved
  division,   ///< the interval is cut into equal blocks, a quarter as many as cells, and each into as many equal cells
              ///< as its share of the error asks for: twice as many cells as before in all, of few sizes. With the
              ///< cells asked for once more
};
const char* to_string(Refinement);

/// Beside Options: `steps` is the number of cells to refine to (the scene's default; without limit where cycles or a
/// tolerance are given and steps are not), `tolerance` the error of the quantity, absolute, to be estimated at its end.
struct GoalOptions {
  StepScheme scheme = StepScheme::euler;
  std::shared_ptr<const QuantityOfInterest> quantity;  ///< null: local_balance()
  AdjointChoice adjoint;
  CellWeights weights = CellWeights::local;
  Refinement refinement = Refinement::bisection;
  /// Of bisection. Share of the estimated error whose cells are halved (Doerfler), in (0, 1]; 0: economical_cells
  /// chooses.
  double marking = 0;
  Index first_cells = 20;  ///< of the first grid, equal but for the jumps of the input
  Index cycles = 0;        ///< refinements; 0 = as many as steps or tolerance ask for
  Vector first_grid;       ///< instead of first_cells: times 0 to T
};

/// One grid of the cycle.
struct GoalCycle {
  Index cells = 0;
  Index sizes = 0;      ///< distinct step sizes
  double quantity = 0;  ///< I(x_h)
  double estimate = 0;  ///< of I(x_h) - I(x): indicators summed with their signs
  double absolute = 0;  ///< their absolute values summed
  /// estimate / (I(x_h) - I(x)), where I(x) is known and the difference is above the rounding of the estimate and of
  /// I(x_h), and the grid sees the input.
  std::optional<double> effectivity;
  double seconds = 0;
};

/// What method goal adds to a Result.
struct GoalReport {
  std::string quantity, scheme, adjoint, weights;
  std::optional<double> exact;
  std::vector<GoalCycle> history;  ///< the grid of the result is the last
  EnergyBalance balance;           ///< of the result
  PowerBalance power;
};

/// What one solution on one grid tells.
struct GoalEvaluation {
  RowMatrix x;  ///< (M+1) x m
  double quantity = 0;
  Vector indicators;  ///< M, with signs: what cell i contributes to I(x_h) - I(x)
  Index sizes = 0;
  std::string elsewhere;  ///< what another machine than the backend's has done (StepChain::elsewhere)
  double rounding = 0;    ///< of the quantity: what is below is noise
  bool blind = false;     ///< the steps hardly see the input: it vanishes where they look, and not in between
};

}  // namespace bromwich

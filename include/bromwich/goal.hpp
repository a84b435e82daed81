#pragma once
// Method goal: quantities of interest, options, and what a result has beside the solution (docs/goal.md).

#include "time_function.hpp"
#include "types.hpp"

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// S, R of one step of x' = A x + ...: implicit Euler I - hA, I; implicit midpoint I - hA/2, I + hA/2; exponential I,
/// e^{hA} (dense).
enum class StepScheme { euler, midpoint, exponential };

/// exact: substitution or scan, whichever is faster on the backend and fits.
enum class AdjointMethod { exact, substitution, jacobi, doubling, scan };

struct AdjointChoice {
  AdjointMethod method = AdjointMethod::exact;
  Index sweeps = 1;  ///< Jacobi sweeps, at least 1

  /// Returns `sweeps`. Throws Error if it is less than one.
  Index checked_sweeps() const;
};

/// A functional I of the trajectory.
class QuantityOfInterest;

/// I_glob = (Σ_i v_i)^2, the violation of the energy balance over [0, T].
std::shared_ptr<const QuantityOfInterest> global_balance();

/// I_loc = Σ_cells v^2.
std::shared_ptr<const QuantityOfInterest> local_balance();

/// I_loc + rho ∫ |x|^2 dt. Throws Error if rho is negative or not finite.
std::shared_ptr<const QuantityOfInterest> weighted_balance(double rho);

/// A user-defined quantity ∫ j(t, x) dt + e(x(T)), each term with its gradient; either may be omitted.
struct UserQuantity {
  std::string name = "user";
  std::function<double(double t, const Vector&x)> density, end;  ///< `end` is called with t = T
  std::function<Vector(double t, const Vector&x)> density_gradient, end_gradient;
  std::vector<double> breakpoints;  ///< of the density
  std::optional<double> exact;
};
/// Throws Error if a function is given without its gradient, or if both are omitted.
std::shared_ptr<const QuantityOfInterest> user_quantity(UserQuantity);

/// ∫ (x^T W x + c(t)^T x) dt + x(T)^T end_W x(T) + end_c^T x(T); empty members are 0.
struct QuadraticQuantity {
  std::string name = "user";
  SparseMatrix W, end_W;            ///< m x m
  TimeFunction c;                   ///< m values
  Vector end_c;                     ///< m
  std::vector<double> breakpoints;  ///< of c
  std::optional<double> exact;
};
/// Throws Error if all members are empty or a member has the wrong size; names the member.
std::shared_ptr<const QuantityOfInterest> quadratic_quantity(const QuadraticQuantity&, Index states);

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

struct EnergyBalance {
  Vector energy;      ///< M+1: H(x_i)
  Vector supplied;    ///< M: through the ports during the step, ∫ u^T B^T Q x
  Vector dissipated;  ///< M: during the step
  Vector violation;   ///< M: dissipated - supplied + change of energy
};

/// Both terms of dH/dt = supplied - dissipated at the time points, with the left limit of u (at t = 0 the right limit).
struct PowerBalance {
  Vector supplied;    ///< M+1: u^T B^T Q x, and y^T B^T Q^T E x of constraints
  Vector dissipated;  ///< M+1: x^T Q^T R Q x
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

}  // namespace bromwich

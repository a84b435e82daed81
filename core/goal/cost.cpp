#include "core/goal/cost.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"

#include <algorithm>

namespace bromwich {
namespace {

constexpr double goal_arrays = 22;             ///< of states x cells: 6 on the grid, 8 on the halved one
constexpr double goal_constraint_arrays = 20;  ///< y at the nodes of both grids

}  // namespace

GoalCost predicted_goal_cost(const PortSystem& system, StepScheme scheme, Index constraints, Index cells, Index sizes) {
  const double m = double(system.states()), n = double(constraints), M = double(cells) + 1, K = double(sizes);
  // u and its times: on the grid and the halved one at the fractions of a step that the scheme uses, and on two grids
  // at the fractions for the test of blindness.
  const double fractions = scheme == StepScheme::euler ? 1 : scheme == StepScheme::midpoint ? 3 : 5;
  const double inputs = (3 * fractions + 2 * 3) * (double(system.port().ports()) + 1);
  GoalCost cost{sizeof(double) * M * (goal_arrays * m + goal_constraint_arrays * n + inputs), 0};
  if (system.dense_steps(scheme)) {
    cost.steps = sizeof(double) * m * m * (8 * K + 10);  // S, R, S^{-1} R and S^{-1}, of both grids
  } else {
    const double entries = double(system.port().J.nonZeros() + system.port().R.nonZeros() + system.port().E.nonZeros());
    cost.steps = 2 * K * (40 * 16 * m + 5 * 16 * entries);  // factors with little fill, S and R
  }
  return cost;
}

Index most_goal_cells(const PortSystem& system, StepScheme scheme, Index constraints, Index sizes, double limit) {
  const double none = predicted_goal_cost(system, scheme, constraints, 0, sizes).bytes();
  const double each = predicted_goal_cost(system, scheme, constraints, 1, sizes).bytes() - none;
  return limit > none ? Index(std::min((limit - none) / each, 1e15)) : 0;
}

void refuse_goal_beyond(double limit, const GoalCost& cost, const PortSystem& system, Index cells, Index sizes) {
  if (!(limit > 0) || cost.bytes() <= limit) return;
  throw Error(
      "steps",
      text("%td of %td sizes with %td states would take %.2g bytes where %.2g may be used", cells, sizes,
           system.states(), cost.bytes(), limit),
      cost.steps > cost.arrays ? "use fewer step sizes, scheme euler or midpoint, or fewer states" : "use fewer steps");
}

}  // namespace bromwich

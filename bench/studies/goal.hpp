#pragma once
// What the parts of `bench goal` share: a scene with its port-Hamiltonian system, and judged trajectories.

#include "bench/studies/study.hpp"
#include "core/goal/goal.hpp"

namespace bromwich::app {

struct GoalScene {
  std::string label;
  ParameterValues parameters;
  Scene scene;
  PortSystem system;

  GoalScene(std::string label, const std::string& name, ParameterValues parameters);
};

/// The balance of a trajectory by its own scheme, by implicit Euler's quadrature (right end points, what the paper
/// takes for all solvers) and by straight lines between the points; and its error, against 64 exponential steps in
/// each.
Json judged(const GoalScene&, Backend&, StepScheme, const Vector& t, const RowMatrix& x);

/// x of a scheme on a grid.
RowMatrix trajectory(const GoalScene&, Backend&, StepScheme, const Vector& t);

/// Equal h |x'| in all cells, the least Σ v^2 that implicit Euler can have with M cells (for M to infinity).
Vector equidistributed(const GoalScene&, Backend&, Index M);

/// The curves behind the pictures: trajectories, violations and adjoints on a few grids.
Json goal_figures(Backend&, bool quick);

}  // namespace bromwich::app

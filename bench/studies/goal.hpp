#pragma once
// Common parts of `bench goal`: a scene with its port-Hamiltonian system, and trajectories with their errors.

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

/// The balance of a trajectory by its own scheme, by implicit Euler's quadrature (right end points, as the paper does
/// for all solvers) and by straight lines between the points; and its error, relative to 64 exponential steps in each
/// step.
Json judged(const GoalScene&, Backend&, StepScheme, const Vector& t, const RowMatrix& x);

/// x of a scheme on a grid.
RowMatrix trajectory(const GoalScene&, Backend&, StepScheme, const Vector& t);

/// Equal h |x'| in all cells: the smallest Σ v^2 of implicit Euler with M cells (as M tends to infinity).
Vector equidistributed(const GoalScene&, Backend&, Index M);

/// The curves behind the pictures: trajectories, violations and adjoints on a few grids.
Json goal_figures(Backend&, bool quick);

}  // namespace bromwich::app

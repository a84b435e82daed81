#pragma once
// Error control: the step is halved until the error, estimated from the grids themselves, is below a tolerance.
//
// core/accuracy/grid_differences.hpp estimates an error from the differences of the grids.
// core/accuracy/convergence.hpp decides what is compared: y, or its mean where y jumps, and the states. y_0 does not
// depend on the grid and is left out. An error in the first steps counts like any other, at the time points that a grid
// has. To the discretisation come the error of the weights (kernel_error |y|), that of the iteration, c/(1-c) times the
// last change where sweeps contract by c, and rounding, carried along the solution.

#include "given_steps.hpp"

namespace bromwich {

/// The change that further sweeps would make, estimated from the changes of all sweeps.
double iteration_error(const std::vector<double>& history);

/// Where controls_error(options): solves on J, 2J, 4J, ... steps, J = options.steps or as often half of the scene's
/// default as leaves 16 steps and an integer. Returns the finest grid. It is `solved` where it has at least the steps
/// of the scene and the estimate, with two observed orders behind it, is below 0.8 of the tolerance. The remaining
/// fifth is for the error of the estimate. Otherwise it goes on until a budget is spent (max_steps, max_seconds,
/// memory) or further grids are of no use, and ends as tolerance_not_met with the reason. Where y may jump, a grid of
/// 3/4 of the steps has to agree. Counts are those of the finest grid, seconds those of all.
///
/// Small dense scenes with initial values are given to event-driven integration (core/solve/event_control.hpp), whose
/// errors are far below the tolerance, and to grids in turn, as long as these are expected to need fewer operations
/// than the integration still does. Grids are for other scenes, and for those that it gives up.
Result solve_to_tolerance(const Scene&, Backend&, const InnerOptions&);

/// The same with the method of the options for the grids, in turn with located events.
Result solve_beside_events(const Scene&, Backend&, const InnerOptions&);

/// Method events by name, to a tolerance or on one grid.
Result solve_by_events(const Scene&, Backend&, const InnerOptions&);

}  // namespace bromwich

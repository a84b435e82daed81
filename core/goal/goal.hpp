#pragma once
// A time grid adapted to a quantity of interest (Bartel, Schaller, Goal-oriented time adaptivity for port-Hamiltonian
// systems). One cycle solves the scene and the adjoint equation, weights the residual of each cell with the adjoint,
// and halves the cells that contribute most to the error. docs/goal.md has the mathematics.

#include "../result/options.hpp"
#include "../result/result.hpp"
#include "../seam/backend.hpp"
#include "options.hpp"

namespace bromwich {

/// Solves on grids adapted to Options::goal; the result is that of the last grid, its member `goal` has all of them.
/// Throws Error for scenes that are not port-Hamiltonian, and for options out of range.
Result solve_for_goal(const Scene&, Backend&, const Options&);

/// Solution, quantity and indicators on the given grid t (M+1 times from 0 to T), for tests and studies.
GoalEvaluation evaluate_goal(const PortSystem&, Backend&, const GoalOptions&, const Vector& t, const Vector& x0);

}  // namespace bromwich

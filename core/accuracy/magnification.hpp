#pragma once
// How a discrete solution magnifies perturbations and rounding errors. A small residual does not show this.

#include "../kernel/discrete_problem.hpp"
#include "../kernel/recurrence.hpp"

namespace bromwich {

/// How the scene magnifies perturbations of its state along a solution: with the active sets S_j of y fixed,
///
///     dy_S = -(M + W_0)_SS^{-1} C dz_{j-1},   dz_j = E dz_{j-1} + G dy.
///
/// One dz with parts in all components that the solution moves shows by how much errors grow, in the norm |D^{-1} x|, D
/// the largest value of each component. Another one is what rounding makes of this very solution: it starts from 0 and
/// takes the rounding of each component's terms at every step, so that nothing arises where components are decoupled.
/// Sizes are the largest |D^{-1} x_i| so far (that of an impulse: up to T), or the terms that x_i is summed from where
/// these are larger and cancel.
struct Magnification {
  double growth = 1;    ///< largest growth of dz from any step to any later one
  double rounding = 0;  ///< largest size of what rounding makes of the state, relative to its size up to there
  double output = 0;    ///< the same of y, not relative
  double impulse = 0;  ///< largest h |B y_j| / size, with its growth up to T, where the active set of row j is not that
                       ///< of both its neighbours: a contact that begins and ends within few steps is not resolved
  double correction =
      0;         ///< of y, for the state that goes with it (core/kernel/closed_loop.hpp), relative to the largest y
  Vector scale;  ///< D, m; 0 where the solution does not move a component
  RowMatrix x;   ///< (J+1) x m, the states; empty where they were not needed
};

/// With the recurrence of the rule: implicit Euler where continuous y would ring, whose states then are `recorded` (all
/// of them, or none). Dense dynamics; NaN and no scale where the scene is not dense or too large for a pass over its
/// state.
Magnification magnification(const DiscreteProblem&, Rule, const RowMatrix& y, const RowMatrix& recorded = {});

/// The rate of the fastest growing mode of sparse dynamics, where their spectrum says that there is one. 0: there is
/// none, or constraints and recorded states do not see it, or nothing excites it. Costs two real factorizations.
double growth_rate(const DiscreteProblem&);

/// How y or x changes when the step is halved, on the nodes that both grids have (`fine` has twice the steps), rows
/// 1..last of the coarse one. A jump that moves by a step is a large change at one time point, a small one in the mean,
/// and none at 95 of 100 time points.
struct Change {
  double largest = 0;  ///< over the largest value
  double typical = 0;  ///< the 95th percentile of the rows, over the largest value
  double mean = 0;     ///< sum over the sum of all values
};
Change change_when_halved(const RowMatrix& coarse, const RowMatrix& fine, Index last);

}  // namespace bromwich

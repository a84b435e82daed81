#pragma once
// What a small residual does not show: whether the discrete solution can be trusted.

#include "discrete_problem.hpp"
#include "recurrence.hpp"

namespace bromwich {

/// How the scene magnifies perturbations of its state along a solution: with the active sets S_j of y fixed,
///
///     dy_S = -(M + W_0)_SS^{-1} C dz_{j-1},   dz_j = E dz_{j-1} + G dy,
///
/// one random dz is carried along and its growth per step rho_j gives e_j = rho_j e_{j-1} + eps |x_j|.
struct Magnification {
  double growth = 1;    ///< largest growth of dz from any step to any later one
  double rounding = 0;  ///< max e_j over the largest |x_j|: what rounding alone may have left of the digits
  double impulse = 0;   ///< largest h |B y_j| over the largest |x_j| where the active set of row j is not that of both
                        ///< its neighbours: a contact that begins and ends within few steps is not resolved
};

/// With the recurrence of the rule: implicit Euler where continuous y would ring. Dense dynamics; NaN in both where the
/// scene is not dense or too large for a pass over its state.
Magnification magnification(const DiscreteProblem&, Rule, const RowMatrix& y);

/// How y or x changes when the step is halved, on the nodes that both grids have (`fine` has twice the steps), rows
/// 1..last of the coarse one. A jump that moves by a step is a large change at one time point, a small one in the mean,
/// and none at 95 of 100 time points.
struct Change {
  double largest = 0;  ///< over the largest value
  double typical = 0;  ///< the 95th percentile of the rows, over the largest value
  double mean = 0;     ///< sum over the sum of all values
};
Change change_when_halved(const RowMatrix& coarse, const RowMatrix& fine, Index last);

/// h Σ_{i<=j} y_i for all rows j >= 1, row 0 = 0: what y does to the state, impulses included.
RowMatrix running_integral(const RowMatrix& y, double h);

}  // namespace bromwich

#pragma once
// What a small residual does not show: whether the discrete solution can be trusted.

#include "discrete_problem.hpp"
#include "recurrence.hpp"

namespace bromwich {

/// How the scene magnifies perturbations of its state along a solution: with the active sets S_j of y fixed,
///
///     dy_S = -(M + W_0)_SS^{-1} C dz_{j-1},   dz_j = E dz_{j-1} + G dy,
///
/// one random dz is carried along and its growth per step rho_j gives e_j = rho_j e_{j-1} + eps |z_j|.
struct Magnification {
  double growth = 1;    ///< largest growth of dz from any step to any later one, over that of the state's largest norm
  double rounding = 0;  ///< max e_j over the largest |z_j|: what rounding alone may have left of the digits
};

/// With the recurrence of the rule: implicit Euler where continuous y would ring. Dense dynamics; NaN in both where the
/// scene is not dense or too large for a pass over its state.
Magnification magnification(const DiscreteProblem&, Rule, const RowMatrix& y);

/// How y changes when the step is halved, on the nodes that both grids have (`fine` has twice the steps), rows 1..last
/// of the coarse one. A jump of y that moves by a step is a large change at one time point and a small one in the mean.
struct Change {
  double largest = 0;  ///< over the largest |y|
  double mean = 0;     ///< sum over the sum of |y|
};
Change change_when_halved(const RowMatrix& coarse, const RowMatrix& fine, Index last);

}  // namespace bromwich

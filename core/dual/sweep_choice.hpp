#pragma once
// The divisor d of the sweeps w <- max(0, w - (V w + s)/d), from the symbol of a cycle with two grids where w > 0:
//
//     (1 - V/d)^after (1 - I V_c^{-1} R V) (1 - V/d)^before
//
// with R the values that the coarse grid shares with the fine one, I linear interpolation, V_c of implicit Euler. With
// the step h on the fine grid and 2h on the coarse one it couples the frequencies omega and omega + pi. With the two
// stages of Radau IIA on the fine grid and implicit Euler with the same step on the coarse one, it couples the stages.

#include "../base/types.hpp"
#include "../seam/fused_operations.hpp"

#include <functional>

namespace bromwich {

/// V^ at z of some modes.
using ModeSymbols = std::function<ComplexVector(Complex z)>;

struct SweepChoice {
  double shift = 0;           ///< d
  StageDivisors stages = {};  ///< d with two stages
  /// Forecast of a cycle: the largest ||E^2||^{1/2} over modes and frequencies, E that of a cycle with two grids.
  double contraction = 0;
  double smoothing = 0;  ///< largest |1 - V/d| where the coarse grid sees nothing
};

/// The d that minimises the contraction on a grid with this step.
SweepChoice choose_sweep(const ModeSymbols&, double h, Index stages, int before, int after);

/// Eigenvalues of Delta(zeta)/h of Radau IIA with two stages, where its convolution quadrature takes V^.
struct RadauPoints {
  Complex first, second;
};
RadauPoints radau_frequencies(Complex zeta, double h);

/// f(Delta(zeta)/h), 2 x 2, from the values at these points.
Eigen::Matrix2cd radau_symbol(Complex zeta, double h, Complex at_first, Complex at_second);

}  // namespace bromwich

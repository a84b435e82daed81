#pragma once
// The divisors d of the sweeps w <- max(0, w - (V w + s)/d), from the symbol of a cycle with two grids where w > 0:
//
//     (1 - V/d)^after (1 - I V_c^{-1} R V) Π_i (1 - V/d_i),   d_i = d (1 + r cos((2i - 1) pi/(2 before)))
//
// d_i are the Chebyshev nodes of [d (1 - r), d (1 + r)], r the relative half-width of the spectrum of V_0, the largest
// first: it damps what the later ones amplify. The sweeps after the correction have d itself.
//
// with R the values that the coarse grid shares with the fine one, I linear interpolation, V_c of implicit Euler. With
// the step h on the fine grid and 2h on the coarse one it couples the frequencies omega and omega + pi. With the two
// stages of Radau IIA on the fine grid and implicit Euler with the same step on the coarse one, it couples the stages.

#include "../base/types.hpp"
#include "../seam/fused_operations.hpp"

#include <functional>
#include <vector>

namespace bromwich {

/// V^ at z of some modes.
using ModeSymbols = std::function<ComplexVector(Complex z)>;

struct SweepChoice {
  double shift = 0;                        ///< d
  std::vector<double> shifts = {};         ///< d_i of the sweeps before, then d
  std::vector<StageDivisors> stages = {};  ///< the same with two stages, lower triangular 2 x 2
  /// Forecast of a cycle: the largest ||E^2||^{1/2} over modes and frequencies, E that of a cycle with two grids.
  double contraction = 0;
  double smoothing = 0;  ///< largest |1 - V/d| where the coarse grid sees nothing
};

/// The d that minimises the contraction on a grid with this step. Without `vary` all d_i are d.
SweepChoice choose_sweep(const ModeSymbols&, double h, Index stages, int before, int after, bool vary = true);

/// Eigenvalues of Delta(zeta)/h of Radau IIA with two stages, where its convolution quadrature takes V^.
struct RadauPoints {
  Complex first, second;
};
RadauPoints radau_frequencies(Complex zeta, double h);

/// f(Delta(zeta)/h), 2 x 2, from the values at these points.
Eigen::Matrix2cd radau_symbol(Complex zeta, double h, Complex at_first, Complex at_second);

}  // namespace bromwich

#pragma once
// Natural units: variables are scaled to about size 1 before a scene is solved, and the result is scaled back to the
// user's units, so that no decision of a solve depends on them.
//
//     x = X x~,   y = Y y~,   w = W w~   (diagonal)
//     A~ = X^{-1} A X,  B~ = X^{-1} B Y,  N~ = W^{-1} N X,  M~ = W^{-1} M Y,  f~ = X^{-1} f,  g~ = W^{-1} g
//
// The factors are powers of ten near core/scene/natural_sizes.hpp. A user who changes units by powers of ten changes
// them by exactly these powers: the scene that is solved stays the same to the rounding of its data, and so do all
// decisions. If all sizes are near 1, nothing is scaled. Time is not scaled: A h and T/h have no unit.
//
// The class of M must not change: P and Z hold for all positive factors. PSD needs M~ = c S^{-1} D M D, that is
// W Y = c S, with S = I if M is PSD as stated, otherwise the S that makes |M| symmetric. Kronecker sums allow common
// factors only. If |A| can be made symmetric, as in energy coordinates, the states get these factors times a common
// one.

#include "../scene/natural_units.hpp"
#include "reduction.hpp"

#include <vector>

namespace bromwich {

NaturalUnits natural_units(const Scene&);

/// The scene in these units, without its port-Hamiltonian structure and its exact solution.
Scene in_natural_units(const Scene&, const NaturalUnits&);

/// Converts y, x, their left values, the trace and the rounding of y from natural units to those of the scene; not the
/// residuals.
Result to_units_of_scene(Result, const NaturalUnits&);

/// max_j ||min(y, w)|| / max(1, ||N x + g||) of the valid rows of a result with its trace, |w_i| where row i is free;
/// NaN where none is.
double stated_residual(const Scene&, const Result&);

/// Result::residual from that, where it was measured and the rows hold both sides of w.
void take_stated_residual(const Scene&, Result&);

/// Nothing where all sizes are near 1, and for method goal. The residuals of a solve are those of the given scene.
std::optional<Reduction> natural_units_of(const Scene&, const InnerOptions&);

}  // namespace bromwich

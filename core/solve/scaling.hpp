#pragma once
// Natural units: variables are brought to about size 1 before a scene is solved, and its result back to the user's
// units afterwards, so that what is decided inside does not depend on these.
//
//     x = X x~,   y = Y y~,   w = W w~   (diagonal)
//     A~ = X^{-1} A X,  B~ = X^{-1} B Y,  N~ = W^{-1} N X,  M~ = W^{-1} M Y,  f~ = X^{-1} f,  g~ = W^{-1} g
//
// The factors are powers of ten near core/scene/natural_sizes.hpp. A user who changes units by powers of ten changes
// them by exactly these powers: the scene that is solved stays the same to the rounding of its data, and so do all
// decisions. Where all sizes are near 1 nothing is done. Time is not scaled: nothing depends on its unit, A h and T/h
// have none.
//
// What has to stay: P and Z do under all positive factors. PSD needs M~ = c S^{-1} D M D, that is W Y = c S, with S = I
// where M is PSD as stated, otherwise the S that makes |M| symmetric. Kronecker sums allow common factors only; where
// |A| can be made symmetric, as in energy coordinates, the states are scaled by that, up to a common factor.

#include "../scene/natural_units.hpp"
#include "stage.hpp"

#include <vector>

namespace bromwich {

NaturalUnits natural_units(const Scene&);

/// The scene in these units. The structure it was made from and its exact solution stay behind.
Scene in_natural_units(const Scene&, const NaturalUnits&);

/// y, x, their left values, the trace and the rounding of y of a result, from natural units to those of the scene;
/// residuals are not touched.
Result to_units_of_scene(Result, const NaturalUnits&);

/// `solve` for a valid scene and options without units: brings both to natural units, solves, and brings the result
/// back. Its residuals are those of the scene as stated.
Result solve_in_natural_units(const Scene&, Backend&, const InnerOptions&, const Solve&);

}  // namespace bromwich

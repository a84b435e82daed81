#pragma once
// Constant advection along and across a side: the scene is solved in its symmetric form
// (core/dynamics/grid_system.hpp),
//
//     A~ = X^{-1} A X,  B~ = X^{-1} B Y,  N~ = Y^{-1} N X,  M~ = Y^{-1} M Y,  phi~ = Y^{-1} phi,  g~ = Y^{-1} g,
//
// which is a Kronecker sum in modes, and its result is scaled back. An error of K~ relative to its largest entry grows
// by at most max Y / min Y, and the kernel error that is reported contains this factor.

#include "reduction.hpp"

#include <optional>

namespace bromwich {

/// Nothing where there is no such form, or the scene has parts that it does not take: f of single states, boundary
/// values, free rows, a tolerance for the given components, M of a class that factors may change, or a method that
/// steps the given matrices.
std::optional<Reduction> symmetric_form(const Scene&, const InnerOptions&);

}  // namespace bromwich

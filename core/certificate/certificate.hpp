#pragma once
// What the rows of a result are worth, for dense dynamics with initial values.
//
// y is linear on every step. The state that it drives is known by the exact flow (part_weights.hpp) with the true
// sources, and with it w inside the steps:
//
//     backward error   d(t) = |min(w, D y)| / s,   D = diag(M), or what y_i moves w_i by within a part,
//                      s = max_t (|M||y| + |N||x| + |g|):
//                      the result is exact for a scene whose g is off by d s.
//     error            the difference from a solution of the same scene with located switches (core/events), which
//                      shares no step, rule or weight with the result. Where the scene magnifies errors, the two part.
//
// The error is no Newton correction with the active sets of y held (one linear march by the exact flow): where y acts
// on the second derivative of w, w = 0 at both nodes of a part doubles the velocity that is left at its begin.

#include "../result/result.hpp"
#include "../scene/scene.hpp"

#include <optional>

namespace bromwich {

/// `breakpoints`: of f and g. `states`: all of the result, (J+1) x m, or none: then those of the exact flow count.
/// Nothing where the scene or the result is of another kind: dense dynamics without E, at most 96 states and 72
/// constraints, x(0) = x0, no free rows, y known up to T; and where located switches find no solution, or one that may
/// not be the only one.
std::optional<Certificate> certify(const Scene&, const Result&, const std::vector<double>& breakpoints,
                                   const RowMatrix& states = {});

}  // namespace bromwich

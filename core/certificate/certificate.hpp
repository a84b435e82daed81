#pragma once
// What y of a result is worth, computed from y alone, for dense dynamics with initial values.
//
// y is linear on every step. The state that it drives is known by the exact flow (part_weights.hpp) with the true
// sources, and with it w inside the steps:
//
//     backward error   d(t) = |min(w, D y)| / s,   D = diag(M), or what y_i moves w_i by within a part,
//                      s = max_t (|M||y| + |N||x| + |g|):
//                      the result is exact for a scene whose g is off by d s.
//     estimate         one Newton correction: on parts a few times shorter than the steps the active sets of y are
//                      held, and one linear march gives y and x that go with them. Where these break a sign, the
//                      problem of the part is solved. The change of each component is the estimate of its error.
//     share of sets    of time, where the sets of y did not continue the solution.

#include "../result/certificate.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"

#include <optional>

namespace bromwich {

/// `breakpoints`: of f and g. `states`: all of the result, (J+1) x m, or none: then those of the exact flow count.
/// Nothing where the scene or the result is of another kind: dense dynamics without E, at most 64 states and 48
/// constraints, x(0) = x0, no free rows, y known up to T.
std::optional<Certificate> certify(const Scene&, const Result&, const std::vector<double>& breakpoints,
                                   const RowMatrix& states = {});

}  // namespace bromwich

#pragma once
// Method march under a tolerance: steps of their own for all parts of the time (core/adapted/tree_march.hpp), tightened
// until two solutions on the same tree, one with all steps halved, agree.

#include "../result/inner_options.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "error_goal.hpp"

#include <optional>

namespace bromwich {

/// Rows at the ends of `cells` equal parts of [0, T], or at `times`, increasing from 0 to T; `first`: of some grid,
/// whose rounding stays. Nothing where the tolerance is not met with max_steps steps, and where the problems of short
/// steps may have several solutions: two marches over one tree go to the same one, and agree on anything.
std::optional<Result> march_to_tolerance(const Scene&, const InnerOptions&, Index cells, const Result& first,
                                         const Vector& times = {});

}  // namespace bromwich

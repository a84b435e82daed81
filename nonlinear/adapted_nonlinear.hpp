#pragma once
// Nonlinear systems under a tolerance on steps of their own lengths (core/adapted/tree_control.hpp): each is the
// exponential step with y at 1/3 and 1, solved by Josephy-Newton (nonlinear_steps.hpp).

#include "../core/seam/backend.hpp"
#include "bromwich/nonlinear.hpp"
#include "nonlinear_scene.hpp"

#include <optional>
#include <vector>

namespace bromwich {

/// Dense scenes by method march or automatic, one of in_states. `breaks`: times that no step holds inside. Rows at the
/// scene's steps, or at `times`, increasing from 0 to T. Nothing where the scene is another one, or NonlinearOptions::
/// error is not met with max_steps steps.
std::optional<NonlinearResult> march_nonlinear_to_tolerance(const NonlinearScene&, const std::vector<double>& breaks,
                                                            Backend&, const NonlinearOptions&,
                                                            const Vector& times = {});

}  // namespace bromwich

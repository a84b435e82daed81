#pragma once
// Boundary values by shooting on located events (core/shooting).

#include "../result/inner_options.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "../seam/backend.hpp"

#include <string>

namespace bromwich {

/// Empty, or why shooting does not take the scene.
std::string unsuited_to_shooting(const Scene&);

/// x(0) by shooting, and from there the result of method events (core/solve/event_control.hpp), whose estimate of the
/// error includes that of x(0). Throws Error where no constraint is active and the condition leaves a mode open. Status
/// solved, interrupted, or tolerance_not_met with what was tried: the iteration starts from `start`, or where that is
/// empty from rest.
Result solve_by_shooting(const Scene&, Backend&, const InnerOptions&, const Vector& start = {});

}  // namespace bromwich

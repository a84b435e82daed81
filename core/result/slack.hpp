#pragma once

#include "../scene/scene.hpp"
#include "result.hpp"

namespace bromwich {

/// w = N x + M y + g(t) at the times of a result, one row each; empty if N x was not recorded (Options::trace). g is
/// that of the scene now, with its value at t where it jumps.
RowMatrix slack(const Scene&, const Result&);

}  // namespace bromwich

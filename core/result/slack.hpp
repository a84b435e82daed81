#pragma once

#include "../scene/scene.hpp"
#include "result.hpp"

namespace bromwich {

/// w = N x + M y + g(t) at the times of a result, one row each; empty if N x was not recorded (Options::trace). g is
/// that of the scene now. Where it jumps at a row: its value at t, but of methods that locate switches the limit on the
/// side that y is on.
RowMatrix slack(const Scene&, const Result&);
/// The rows first, ..., first + count - 1.
RowMatrix slack(const Scene&, const Result&, Index first, Index count);

}  // namespace bromwich

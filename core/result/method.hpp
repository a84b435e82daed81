#pragma once

#include "bromwich/options.hpp"

namespace bromwich {

/// Whether a method sweeps over all time points, so that its residual is limited by the iteration tolerance.
bool iterates(Method);

/// Whether switches are located, and not known to a step.
bool locates_switches(Method);

}  // namespace bromwich

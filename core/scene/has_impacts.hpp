#pragma once

#include "scene.hpp"

namespace bromwich {

/// Whether contacts of the scene rebound: the state jumps by Newton's law with a coefficient above 0.
inline bool has_impacts(const Scene& scene) { return (scene.restitution.array() > 0).any(); }

}  // namespace bromwich

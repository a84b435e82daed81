#pragma once
// Small scenes for as many steps as wanted, of a fixed length: circuits, a relay in a loop, a cart with a pole.

#include "core/scene/scene.hpp"

#include <string>
#include <vector>

namespace bromwich::study {

/// "ladder", "buck", "diode-bridge", "relay-feedback", "boost", "three-phase" and "cart-pole".
const std::vector<std::string>& chunk_scenes();
/// Throws std::invalid_argument for another name.
Scene chunk_scene(const std::string& name, Index steps);

}  // namespace bromwich::study

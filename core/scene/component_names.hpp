#pragma once
// Names of the components of a scene.

#include "scene.hpp"

#include <string>

namespace bromwich {

/// The name that the user gave, otherwise "x3", "y0", "w0".
std::string state_name(const Scene&, Index component);
std::string multiplier_name(const Scene&, Index component);  ///< of y
std::string slack_name(const Scene&, Index component);       ///< of w
/// The component of x with this name, also "x3"; -1 where there is none.
Index find_state(const Scene&, const std::string& name);

}  // namespace bromwich

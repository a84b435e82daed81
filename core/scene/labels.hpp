#pragma once
// Names and units of the components of a scene, for column headers, axes and messages.

#include "../base/types.hpp"

#include <string>
#include <vector>

namespace bromwich {

/// One text per component of x, y and w of the user's scene; each list is empty where the user gives none. Scenes that
/// stages of a solve make from it may have other components: a list may then have another length.
struct Labels {
  std::vector<std::string> x;  ///< m
  std::vector<std::string> y;  ///< n
  std::vector<std::string> w;  ///< n
};

struct Scene;

/// The name that the user gave, otherwise "x3", "y0", "w0".
std::string state_name(const Scene&, Index component);
std::string multiplier_name(const Scene&, Index component);  ///< of y
std::string slack_name(const Scene&, Index component);       ///< of w
/// The component of x with this name, also "x3"; -1 where there is none.
Index find_state(const Scene&, const std::string& name);

}  // namespace bromwich

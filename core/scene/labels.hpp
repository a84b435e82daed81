#pragma once
// Names and units of the components of a scene, for column headers, axes and messages.

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

}  // namespace bromwich

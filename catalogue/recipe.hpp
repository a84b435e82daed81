#pragma once

#include "../core/scene/scene.hpp"

#include <map>
#include <string>
#include <vector>

namespace bromwich {

struct SceneParameter {
  std::string name;
  double value;  ///< default
  std::string meaning;
  std::string replaces = {};  ///< the parameter that this one may replace; its own default is then NaN, "not given"
};

using ParameterValues = std::map<std::string, double>;

struct SceneRecipe {
  std::string name;
  std::string summary;  ///< one line
  std::vector<SceneParameter> parameters;
  Scene (*build)(const ParameterValues&);  ///< receives all parameters, including defaults
};

}  // namespace bromwich

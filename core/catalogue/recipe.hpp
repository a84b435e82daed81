#pragma once

#include "../scene/scene.hpp"

#include <map>
#include <string>
#include <vector>

namespace bromwich {

struct SceneParameter {
  std::string name;
  double value;  ///< default
  std::string meaning;
  std::string replaces =
      {};  ///< the parameter this one may be given instead of; its own default is then NaN, "not given"
};

using ParameterValues = std::map<std::string, double>;

struct SceneRecipe {
  std::string name;
  std::string summary;  ///< one line
  std::vector<SceneParameter> parameters;
  Scene (*build)(const ParameterValues&);  ///< gets every parameter, defaults filled in
};

}  // namespace bromwich

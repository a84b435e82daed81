#pragma once
// The built-in scenes. Each one is a recipe that makes a Scene from parameters.

#include "scene.hpp"

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

/// All built-in scenes, in the order of `bromwich scenes`.
const std::vector<SceneRecipe>& scene_catalogue();

/// Makes a built-in scene; `overrides` replaces default parameters. Throws Error for an unknown name, an unknown key or
/// a value out of range.
Scene make_scene(const std::string& name, const ParameterValues& overrides = {});

}  // namespace bromwich

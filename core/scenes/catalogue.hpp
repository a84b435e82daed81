#pragma once
// The built-in scenes: each a recipe that turns parameters into a Scene.

#include "../scene.hpp"

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

/// All built-in scenes, in the order they are listed.
const std::vector<SceneRecipe>& scene_catalogue();

/// Builds a built-in scene. Throws Error for an unknown name, an unknown key or a value out of range.
Scene make_scene(const std::string& name, const ParameterValues& overrides = {});

}  // namespace bromwich

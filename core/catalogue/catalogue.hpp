#pragma once
// The built-in scenes. Each one is a recipe that makes a Scene from parameters.

#include "recipe.hpp"

namespace bromwich {

/// All built-in scenes, in the order they are listed.
const std::vector<SceneRecipe>& scene_catalogue();

/// Builds a built-in scene. Throws Error for an unknown name, an unknown key or a value out of range.
Scene make_scene(const std::string& name, const ParameterValues& overrides = {});

}  // namespace bromwich

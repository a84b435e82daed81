#pragma once
// The built-in scenes. Each one is a recipe that makes a Scene from parameters.

#include "recipe.hpp"

namespace bromwich {

/// All built-in scenes, in the order of `bromwich scenes`.
const std::vector<SceneRecipe>& scene_catalogue();

/// Makes a built-in scene; `overrides` replaces default parameters. Throws Error for an unknown name, an unknown key or
/// a value out of range.
Scene make_scene(const std::string& name, const ParameterValues& overrides = {});

}  // namespace bromwich

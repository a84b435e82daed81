#pragma once

#include "core/scenes/catalogue.hpp"

#include <string>

namespace bromwich::app {

/// A built scene and the parameters that it was built from, defaults filled in.
struct SceneChoice {
  Scene scene;
  ParameterValues parameters;
};

/// Throws Error for a name that is no built-in scene and for a key that is none of its parameters, with the nearest one
/// that is, and for values that the scene refuses.
SceneChoice choose_scene(const std::string& name, const ParameterValues& settings);

/// "Q = 39, T = 4"
std::string describe(const ParameterValues& parameters);

/// Throws Error where the arrays that every method holds exceed the memory: systems hand out memory that they do not
/// have, so a mistyped --steps would otherwise be killed half-way without a word.
void check_memory(const Scene& scene, Index steps, Index state_columns);

}  // namespace bromwich::app

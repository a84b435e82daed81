#pragma once
// The recipes of the catalogue, one file each, and their common checks of parameters.

#include "../core/base/error.hpp"
#include "../core/scene/scene.hpp"
#include "bromwich/catalogue.hpp"

#include <sstream>

namespace bromwich {

SceneRecipe signorini_recipe();
SceneRecipe contact_recipe();
SceneRecipe put_recipe();
SceneRecipe put_on_two_recipe();
SceneRecipe dlcp_small_recipe();
SceneRecipe bridge_recipe();
SceneRecipe ph_toy_recipe();
SceneRecipe ladder_recipe();
SceneRecipe ladder_diodes_recipe();
SceneRecipe nash_game_recipe();
SceneRecipe signorini3d_recipe();
SceneRecipe lq_control_recipe();
SceneRecipe periodic_rectifier_recipe();

inline std::string number_text(double value) {
  std::ostringstream out;
  out << value;
  return out.str();
}

/// The parameter `key`, which must be positive.
inline double positive_parameter(const ParameterValues& values, const std::string& key) {
  const double value = values.at(key);
  if (!(value > 0)) throw Error(key, "found " + number_text(value), "give a positive number");
  return value;
}

/// Heat in a square or, with `directions` 3, in a cube, with diffusivity c and Q interior points in each direction, dx
/// = 1/(Q+1). y is the value on one side, b = c/dx^2 e_1, and w sees n = -2 e_1 of its lines.
KroneckerDynamics heat_with_boundary_value(Index Q, int directions, double c);

/// x (1 - x) at the Q interior points of [0, 1].
Vector bump(Index Q);

}  // namespace bromwich

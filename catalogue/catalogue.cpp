#include "catalogue/catalogue.hpp"

#include "catalogue/recipes.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {
namespace {

template <typename Named>
std::string known(const std::vector<Named>& all) {
  std::string names;
  for (const Named& one : all) names += (names.empty() ? "" : ", ") + one.name;
  return names;
}

template <typename Named>
const Named* find(const std::vector<Named>& all, const std::string& name) {
  const auto found = std::find_if(all.begin(), all.end(), [&](const Named& one) { return one.name == name; });
  return found == all.end() ? nullptr : &*found;
}

}  // namespace

const std::vector<SceneRecipe>& scene_catalogue() {
  static const std::vector<SceneRecipe> recipes{
      signorini_recipe(), signorini3d_recipe(), contact_recipe(),       dlcp_small_recipe(),
      bridge_recipe(),    nash_game_recipe(),   lq_control_recipe(),    periodic_rectifier_recipe(),
      ph_toy_recipe(),    ladder_recipe(),      ladder_diodes_recipe(), put_recipe(),
      put_on_two_recipe()};
  return recipes;
}

Scene make_scene(const std::string& name, const ParameterValues& overrides) {
  const SceneRecipe* recipe = find(scene_catalogue(), name);
  if (!recipe)
    throw Error("scene", "found '" + name + "', which is not built in", "choose one of " + known(scene_catalogue()));

  ParameterValues values;
  for (const SceneParameter& parameter : recipe->parameters) values[parameter.name] = parameter.value;

  for (const auto& [key, value] : overrides) {
    const SceneParameter* parameter = find(recipe->parameters, key);
    if (!parameter) throw Error(key, "is no parameter of scene " + name, "choose from " + known(recipe->parameters));
    if (!std::isfinite(value)) throw Error(key, "found " + number_text(value), "give a finite number");
    if (overrides.contains(parameter->replaces))
      throw Error(key, "was given together with " + parameter->replaces, "give one of the two");
    values[key] = value;
  }

  Scene scene = recipe->build(values);
  scene.name = name;
  scene.no_pulses = true;
  scene.validate();
  return scene;
}

}  // namespace bromwich

// Uses core, and what is beside it, where there is nothing else: the built-in scenes are valid.

#include <bromwich/bromwich.hpp>

#include <cstdio>

int main() {
  for (const bromwich::SceneRecipe& recipe : bromwich::scene_catalogue()) {
    bromwich::make_scene(recipe.name).validate();
    std::printf("%s\n", recipe.name.c_str());
  }
  return bromwich::scene_catalogue().empty() ? 1 : 0;
}

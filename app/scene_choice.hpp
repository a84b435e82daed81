#pragma once

#include "core/catalogue/catalogue.hpp"
#include "files/scene_file.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace bromwich::app {

/// A built scene and the parameters that it was built from, defaults filled in.
struct SceneChoice {
  Scene scene;
  ParameterValues parameters;
  std::string states = "none";         ///< default of --states
  std::optional<Reference> reference;  ///< empty where parameters were set: it belongs to those of the file
  std::shared_ptr<const QuantityOfInterest> quantity = {};  ///< of the file; null where it has none
  std::string warning = {};                                 ///< of the file, or empty
  std::vector<std::filesystem::path> inputs = {};           ///< the files it was read from
};

/// A built-in scene or a TOML file. Throws Error for a name that is neither and for a key that is none of its
/// parameters, with the nearest one that is, and for values that the scene refuses.
SceneChoice choose_scene(const std::string& name, const ParameterValues& settings);

/// The same for a study whose methods need initial values: throws Error for boundary values.
SceneChoice choose_initial_value_scene(const std::string& name, const ParameterValues& settings);

/// "Q = 39, T = 4"
std::string describe(const ParameterValues& parameters);

/// Throws Error where the arrays that every method holds exceed the memory: systems hand out memory that they do not
/// have, so a mistyped --steps would otherwise be killed half-way without a word.
void check_memory(const Scene& scene, Index steps, Index state_columns);

}  // namespace bromwich::app

#pragma once

#include "catalogue/catalogue.hpp"
#include "files/scene_file.hpp"
#include "nonlinear/nonlinear_scene.hpp"

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {
struct Circuit;
class SceneReader;
}  // namespace bromwich

namespace bromwich::app {

/// A scene and its parameters, including defaults.
struct SceneChoice {
  Scene scene;
  ParameterValues parameters;
  std::string states = "none";         ///< default of --states
  std::optional<Reference> reference;  ///< empty if parameters were set: it is valid for those of the file
  std::shared_ptr<const QuantityOfInterest> quantity = {};  ///< of the file; null if it has none
  std::string warning = {};                                 ///< of the file, or empty
  std::vector<std::filesystem::path> inputs = {};           ///< the files that were read
  std::optional<Rectangle> rectangle = {};                  ///< of a file with [kronecker]
  std::shared_ptr<const NonlinearScene> system = {};  ///< of a file with [nonlinear], whose linear part is `scene`
  std::shared_ptr<const Circuit> circuit = {};        ///< of a netlist: its outputs; `scene` is its scene
  std::shared_ptr<const Mechanism> mechanism = {};    ///< of a file with [structure]; `scene` is its scene
};

/// A built-in scene, a TOML file or a netlist, for many settings: the file is read once. Not for several threads at
/// once.
class SceneSource {
 public:
  /// As choose_scene, for what is wrong with any settings.
  explicit SceneSource(const std::string& name);
  ~SceneSource();
  /// As choose_scene.
  SceneChoice with(const ParameterValues& settings) { return choice(settings, false); }
  /// As choose_scene_or_system.
  SceneChoice scene_or_system(const ParameterValues& settings) { return choice(settings, true); }
  /// As choose_initial_value_scene.
  SceneChoice initial_value_scene(const ParameterValues& settings);
  /// As SceneReader::sources; 0 for a built-in scene.
  Index sources() const;

 private:
  SceneChoice choice(const ParameterValues& settings, bool nonlinear);

  std::string name_;
  std::unique_ptr<SceneReader> file_;  ///< of a TOML file
};

/// A built-in scene, a TOML file or a netlist. Throws Error for an unknown name, for an unknown parameter (with the
/// nearest known one), and for invalid values.
SceneChoice choose_scene(const std::string& name, const ParameterValues& settings);
/// The same, and files with a section [nonlinear], which choose_scene refuses.
SceneChoice choose_scene_or_system(const std::string& name, const ParameterValues& settings);

/// Seconds of --periodic; 0 of auto. Throws Error naming it.
double parse_period(const std::string&);
/// The periodic state of a netlist; `period`: seconds, or auto. Throws Error naming --periodic for other scenes.
SceneChoice choose_periodic_circuit(const std::string& name, const ParameterValues& settings,
                                    const std::string& period);

/// The same for a study whose methods need initial values: throws Error for boundary values.
SceneChoice choose_initial_value_scene(const std::string& name, const ParameterValues& settings);

/// The parameters of a built-in scene or a file with these settings, without making the scene.
ParameterValues known_parameters(const std::string& name, const ParameterValues& settings);

/// "Q = 39, T = 4"
std::string describe(const ParameterValues& parameters);

/// Throws Error if the arrays of any method exceed the memory. Systems overcommit memory, so with a mistyped --steps
/// the process would otherwise be killed without a message.
void check_memory(const Scene& scene, Index steps, Index state_columns);

}  // namespace bromwich::app

#include "app/scene_choice.hpp"

#include "app/machine.hpp"
#include "app/text.hpp"
#include "circuits/circuit.hpp"
#include "circuits/values.hpp"
#include "core/base/error.hpp"
#include "files/scene_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>

namespace bromwich::app {

namespace {

std::vector<std::string> scene_names() {
  std::vector<std::string> names;
  for (const SceneRecipe& recipe : scene_catalogue()) names.push_back(recipe.name);
  return names;
}

/// Whether SCENE can only be a file name.
bool looks_like_file(const std::string& name) {
  std::string extension = std::filesystem::path(name).extension();
  for (char& c : extension) c = char(std::tolower(static_cast<unsigned char>(c)));
  return extension == ".toml" || is_netlist(name) || name.find('/') != std::string::npos;
}

const SceneRecipe& find_recipe(const std::string& name) {
  for (const SceneRecipe& recipe : scene_catalogue())
    if (recipe.name == name) return recipe;
  const auto names = scene_names();
  std::error_code failure;
  const std::string file = name + ".toml";
  const bool is_file = std::filesystem::exists(file, failure);
  const std::string meant = is_file ? fmt::format(" (did you mean '{}'?)", file) : suggestion(name, names);
  throw Error("SCENE", fmt::format("found '{}'", name) + meant,
              fmt::format("use a built-in scene ({}), a file .toml or a netlist .cir", join(names)));
}

void check_keys(const SceneRecipe& recipe, const ParameterValues& settings) {
  std::vector<std::string> known;
  for (const SceneParameter& parameter : recipe.parameters) known.push_back(parameter.name);
  for (const auto& [key, value] : settings)
    if (std::find(known.begin(), known.end(), key) == known.end())
      throw Error("--set", fmt::format("'{}' is no parameter of {}", key, recipe.name) + suggestion(key, known),
                  known.empty() ? "leave it out" : "use one of " + join(known));
}

SceneChoice choose_built_in(const std::string& name, const ParameterValues& settings) {
  const SceneRecipe& recipe = find_recipe(name);
  check_keys(recipe, settings);
  SceneChoice choice{make_scene(name, settings), settings, "none", std::nullopt};
  for (const SceneParameter& parameter : recipe.parameters) choice.parameters.emplace(parameter.name, parameter.value);
  // Of two parameters that replace each other, only the given one is kept.
  for (const SceneParameter& parameter : recipe.parameters)
    if (!parameter.replaces.empty())
      choice.parameters.erase(settings.contains(parameter.name) ? parameter.replaces : parameter.name);
  return choice;
}

/// Its accuracy is that of the states: y of ideal switches need not be unique.
SceneChoice choose_circuit(const std::string& name, const ParameterValues& settings,
                           std::optional<double> period = {}) {
  constexpr double tolerance = 1e-4;
  auto circuit = std::make_shared<const Circuit>(read_circuit(name, settings, period));
  SceneChoice choice{circuit->scene, circuit->parameters, "all", std::nullopt};
  choice.scene.default_tolerance = tolerance;
  choice.inputs = circuit->inputs;
  choice.circuit = std::move(circuit);
  return choice;
}

}  // namespace

SceneSource::SceneSource(const std::string& name) : name_(name) {
  if (!looks_like_file(name)) {
    find_recipe(name);
    return;
  }
  std::error_code failure;
  if (scene_files_available() && !std::filesystem::exists(name, failure))
    throw Error("SCENE", fmt::format("the file '{}' does not exist", name),
                "give the path of a scene file; 'bromwich solve --template' prints one to start from");
  if (!is_netlist(name)) file_ = std::make_unique<SceneReader>(std::filesystem::path(name));
}

SceneSource::~SceneSource() = default;

SceneChoice SceneSource::choice(const ParameterValues& settings, bool nonlinear) {
  if (is_netlist(name_)) return choose_circuit(name_, settings);
  if (!file_) return choose_built_in(name_, settings);
  NonlinearFile read = nonlinear ? file_->nonlinear(settings) : NonlinearFile{file_->linear(settings), {}};
  SceneFile& file = read.file;
  if (!settings.empty()) file.reference.reset();  // it is valid for the parameters of the file
  SceneChoice choice{std::move(file.scene),
                     std::move(file.parameters),
                     std::move(file.states),
                     std::move(file.reference),
                     std::move(file.quantity),
                     std::move(file.warning),
                     std::move(file.inputs),
                     std::move(file.rectangle),
                     read.system ? std::make_shared<const NonlinearScene>(std::move(*read.system)) : nullptr};
  choice.mechanism = std::move(file.mechanism);
  return choice;
}

Index SceneSource::sources() const { return file_ ? file_->sources() : 0; }

SceneChoice SceneSource::initial_value_scene(const ParameterValues& settings) {
  SceneChoice choice = with(settings);
  if (choice.scene.boundary)
    throw Error("SCENE",
                fmt::format("{} has boundary values, and this study compares methods for initial values", name_),
                "use bench galerkin, or another scene");
  return choice;
}

SceneChoice choose_scene(const std::string& name, const ParameterValues& settings) {
  return SceneSource(name).with(settings);
}

SceneChoice choose_scene_or_system(const std::string& name, const ParameterValues& settings) {
  return SceneSource(name).scene_or_system(settings);
}

SceneChoice choose_periodic_circuit(const std::string& name, const ParameterValues& settings,
                                    const std::string& period) {
  if (!is_netlist(name))
    throw Error("--periodic", fmt::format("is given with {}, which is no netlist", name),
                "write a section [boundary] with E0 and ET = -E0");
  return choose_circuit(name, settings, parse_period(period));
}

double parse_period(const std::string& period) {
  if (period == "auto") return 0;
  const auto seconds = circuits::spice_number(period);
  if (!seconds || !(*seconds > 0))
    throw Error("--periodic", fmt::format("found '{}'", period), "give a period in seconds, 10u or 1e-5, or auto");
  return *seconds;
}

SceneChoice choose_initial_value_scene(const std::string& name, const ParameterValues& settings) {
  return SceneSource(name).initial_value_scene(settings);
}

ParameterValues known_parameters(const std::string& name, const ParameterValues& settings) {
  if (is_netlist(name)) return read_circuit(name, settings).parameters;
  if (looks_like_file(name)) return file_parameters(name, settings);
  ParameterValues values = settings;
  for (const SceneParameter& parameter : find_recipe(name).parameters)
    if (std::isfinite(parameter.value)) values.emplace(parameter.name, parameter.value);
  return values;
}

std::string describe(const ParameterValues& parameters) {
  std::vector<std::string> words;
  for (const auto& [key, value] : parameters) words.push_back(fmt::format("{} = {}", key, value));
  return join(words);
}

void check_memory(const Scene& scene, Index steps, Index state_columns) {
  // y, r, v, the source and the copy of y in the result.
  const double columns = 5 * double(scene.constraints()) + double(state_columns);
  const double needed = sizeof(double) * (double(steps) + 1) * columns;
  if (needed > memory_bytes())
    throw Error("--steps",
                fmt::format("{} steps need more than {} and this machine has {}", steps, format_bytes(needed),
                            format_bytes(memory_bytes())),
                state_columns > 0 ? "use fewer --steps or fewer --states" : "use fewer --steps");
}

}  // namespace bromwich::app

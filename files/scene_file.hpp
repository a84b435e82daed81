#pragma once
// Scenes in TOML files; docs/scene-files.md describes the format.

#include "bromwich/catalogue.hpp"
#include "bromwich/goal.hpp"

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace bromwich {

struct Mechanism;

/// Known values of the solution, not used in solving. Unknown entries are NaN.
struct Reference {
  std::optional<double> t;          ///< the time of x and y
  std::vector<double> x, y;         ///< empty, or m and n values
  std::optional<double> tolerance;  ///< absolute error of x and y of a solve without options
  std::string status = "solved";    ///< expected status of a solve
  std::optional<double> infeasible_at;
  std::string source;  ///< one line
};

struct SceneFile {
  Scene scene;
  std::string description;      ///< one line
  ParameterValues parameters;   ///< of [parameters], with the settings
  std::string states = "none";  ///< components to write: "none", "all" or "0,3"
  std::optional<Reference> reference;
  std::shared_ptr<const QuantityOfInterest> quantity;  ///< of method goal; null if the file has none
  std::string warning;                                 ///< one line about switch times that were not found, or empty
  std::vector<std::filesystem::path> inputs;           ///< the scene file, tables and matrices that were read
  std::optional<Rectangle> rectangle;                  ///< of [kronecker]
  std::shared_ptr<const Mechanism> mechanism;          ///< of [structure] and [[contact]]; null without them
};

/// False if this build has no reader: read_scene_file then throws an Error that names the missing packages.
bool scene_files_available();

/// Reads a scene. `settings` replace values of [parameters]; T and steps, where no parameter has this name, those of
/// [time]. Every Error names file, line and key.
SceneFile read_scene_file(const std::filesystem::path& file, const ParameterValues& settings = {});

/// The same from text. `file_name` is its name in messages; names of other files are relative to `folder`.
SceneFile parse_scene(std::string_view toml, const std::string& file_name, const std::filesystem::path& folder = {},
                      const ParameterValues& settings = {});

/// The values of [parameters] of a file with these settings, as read_scene_file takes them.
ParameterValues file_parameters(const std::filesystem::path& file, const ParameterValues& settings);

/// The value of an expression without t, such as "2*pi/3" or "R/2" with the value of R among `names`. Without a reader
/// only numbers are understood.
double constant_expression(const std::string& text, const ParameterValues& names, const std::string& where);

}  // namespace bromwich

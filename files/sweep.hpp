#pragma once
// [sweep] of a scene file: the values of parameters for many scenes (docs/batches.md).

#include "scene_file.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

struct Sweep {
  std::vector<std::string> names;             ///< parameters, or T
  RowMatrix values;                           ///< one row per scene, one column per name
  std::vector<std::filesystem::path> inputs;  ///< the scene file, and tables that were read
  std::string columns, columns_place;         ///< of the table, as --columns takes them, and where the file has them

  Index scenes() const { return values.rows(); }
  /// The settings of one scene, for read_scene_file.
  ParameterValues settings(Index scene) const;
};

inline constexpr Index most_swept = 10'000'000;

/// The sweep of a file; empty if it has no [sweep]. `settings` replace values of [parameters], which lists and ranges
/// may use. Every Error names file, line and key.
std::optional<Sweep> read_sweep(const std::filesystem::path& file, const ParameterValues& settings = {});

/// The same from text, as parse_scene.
std::optional<Sweep> parse_sweep(std::string_view toml, const std::string& file_name,
                                 const std::filesystem::path& folder = {}, const ParameterValues& settings = {});

}  // namespace bromwich

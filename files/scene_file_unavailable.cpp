// Replaces the reader if toml++ or muParser was not found.

#include "core/base/error.hpp"
#include "files/scene_reader.hpp"
#include "files/sweep.hpp"
#include "files/words.hpp"

namespace bromwich {

bool scene_files_available() { return false; }

SceneFile read_scene_file(const std::filesystem::path& file, const ParameterValues& settings) {
  return parse_scene({}, file.string(), {}, settings);
}

NonlinearFile read_nonlinear_file(const std::filesystem::path& file, const ParameterValues& settings) {
  return {read_scene_file(file, settings), std::nullopt};
}

NonlinearFile parse_nonlinear(std::string_view toml, const std::string& file_name, const std::filesystem::path& folder,
                              const ParameterValues& settings) {
  return {parse_scene(toml, file_name, folder, settings), std::nullopt};
}

SceneFile parse_scene(std::string_view, const std::string& file_name, const std::filesystem::path&,
                      const ParameterValues&) {
  throw Error(file_name, "found a scene file, but this build reads none",
              "install the Debian packages libtomlplusplus-dev and libmuparser-dev and build again");
}

struct SceneReader::File {};
SceneReader::SceneReader(const std::filesystem::path& file) { parse_scene({}, file.string()); }
SceneReader::SceneReader(std::string_view toml, const std::string& file_name, const std::filesystem::path& folder) {
  parse_scene(toml, file_name, folder);
}
SceneReader::~SceneReader() = default;
SceneReader::SceneReader(SceneReader&&) noexcept = default;
SceneReader& SceneReader::operator=(SceneReader&&) noexcept = default;
SceneFile SceneReader::linear(const ParameterValues&) { return {}; }
NonlinearFile SceneReader::nonlinear(const ParameterValues&) { return {}; }
Index SceneReader::sources() const { return 0; }

ParameterValues Sweep::settings(Index) const { return {}; }

std::optional<Sweep> read_sweep(const std::filesystem::path&, const ParameterValues&) { return std::nullopt; }

std::optional<Sweep> parse_sweep(std::string_view, const std::string&, const std::filesystem::path&,
                                 const ParameterValues&) {
  return std::nullopt;
}

ParameterValues file_parameters(const std::filesystem::path&, const ParameterValues&) { return {}; }

double constant_expression(const std::string& text, const ParameterValues&, const std::string& where) {
  const auto value = parse_double(text);
  if (!value) throw Error(where, "found '" + one_line(text) + "'", "give a finite number");
  return *value;
}

}  // namespace bromwich

#pragma once
// A scene file that is read and checked once, for scenes with many values of its parameters.

#include "files/nonlinear_file.hpp"

#include <memory>

namespace bromwich {

/// What depends on no changed parameter is made once: scenes share their dynamics, matrices and sources, and tables are
/// read once. Not for several threads at once.
class SceneReader {
 public:
  /// Throws Error as read_scene_file, for what is wrong whatever the parameters are.
  explicit SceneReader(const std::filesystem::path& file);
  /// The same from text, as parse_scene.
  SceneReader(std::string_view toml, const std::string& file_name, const std::filesystem::path& folder = {});
  ~SceneReader();
  SceneReader(SceneReader&&) noexcept;
  SceneReader& operator=(SceneReader&&) noexcept;

  /// The scene with these settings, as read_scene_file takes them.
  SceneFile linear(const ParameterValues& settings = {});
  /// As read_nonlinear_file.
  NonlinearFile nonlinear(const ParameterValues& settings = {});
  /// A number of the sources of the last scene: scenes with equal numbers have the same f, g, switch times and T.
  Index sources() const;

 private:
  struct File;
  std::unique_ptr<File> file_;
};

}  // namespace bromwich

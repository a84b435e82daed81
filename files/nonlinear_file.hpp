#pragma once
// Scene files with a section [nonlinear]; docs/nonlinear.md and docs/scene-files.md describe them.

#include "bromwich/nonlinear.hpp"
#include "scene_file.hpp"

#include <optional>

namespace bromwich {

struct NonlinearFile {
  SceneFile file;                        ///< with the linear part as its scene
  std::optional<NonlinearScene> system;  ///< empty where the file has no section [nonlinear]
};

/// Reads a scene file with or without a section [nonlinear]; read_scene_file refuses those with one, whose scene is a
/// part of the system only. Throws Error as read_scene_file.
NonlinearFile read_nonlinear_file(const std::filesystem::path& file, const ParameterValues& settings = {});

/// The same from text, as parse_scene.
NonlinearFile parse_nonlinear(std::string_view toml, const std::string& file_name,
                              const std::filesystem::path& folder = {}, const ParameterValues& settings = {});

}  // namespace bromwich

// `bromwich scenes` and `bromwich info`.

#include "app/backend_choice.hpp"
#include "app/commands.hpp"
#include "app/machine.hpp"
#include "app/ranks.hpp"
#include "app/scene_choice.hpp"
#include "app/text.hpp"
#include "core/base/error.hpp"
#include "core/build_info.hpp"
#include "cpu/cpu_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <iterator>

namespace bromwich::app {

namespace {

/// "Q=39 (or dx) T=4"
std::string defaults(const SceneRecipe& recipe) {
  std::vector<std::string> words;
  for (const SceneParameter& parameter : recipe.parameters)
    words.push_back(parameter.replaces.empty() ? fmt::format("{}={}", parameter.name, parameter.value)
                                               : fmt::format("(or {})", parameter.name));
  return fmt::format("{}", fmt::join(words, " "));
}

}  // namespace

void print(const std::string& text) {
  if (!first_rank()) return;
  const bool short_write = std::fwrite(text.data(), 1, text.size(), stdout) != text.size();
  if (std::fflush(stdout) != 0 || short_write)
    throw Error("standard output", "could not be written", "check where it is redirected to");
}

int run_scenes(const std::string& scene) {
  if (!scene.empty()) {
    std::string lines;
    for (const auto& [name, value] : known_parameters(scene, {})) lines += fmt::format("{}={}\n", name, value);
    print(lines);
    return exit_solved;
  }
  std::string text;
  for (const SceneRecipe& recipe : scene_catalogue())
    fmt::format_to(std::back_inserter(text), "{}  {}\n    {}\n", recipe.name, defaults(recipe), recipe.summary);
  text += scene_files_available()
              ? "FILE.toml\n    a scene of your own: 'bromwich solve --template > my.toml' prints one to start from\n"
              : "this build reads no scene files (.toml): toml++ or muParser was not found when it was built\n";
  print(text);
  return exit_solved;
}

int run_info() {
  const auto backend = make_cpu_backend();
  const DeviceInfo device = backend->device();
  std::string text;
  const auto line = [&text](const char* label, const std::string& value) {
    fmt::format_to(std::back_inserter(text), "{:<10} {}\n", label, value);
  };
  line("version", fmt::format("{} (commit {})", build_info::version, build_info::commit));
  line("compiler", fmt::format("{}, {}", build_info::compiler, build_info::build_type));
  line("flags", build_info::flags);
  line("backends", backend_list());
  line("device",
       fmt::format("{}: {}{}{}", backend->name(), device.name, device.detail.empty() ? "" : ", ", device.detail));
  line("threads", fmt::format("{}", device.threads));
  line("memory", format_bytes(memory_bytes()));
  print(text);
  return exit_solved;
}

}  // namespace bromwich::app

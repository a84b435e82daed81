#include "bench/frozen/cases.hpp"

#include "bench/studies/stability.hpp"
#include "core/base/text.hpp"
#include "core/solve/solve.hpp"
#include "files/scene_file.hpp"
#include "tests/support/random_scenes.hpp"
#include "tests/support/random_sources.hpp"

#include <algorithm>
#include <array>
#include <memory>

namespace bromwich::frozen {

namespace {

Result solve_with_states(const Scene& scene, Backend& backend, Options options, std::function<bool()> interrupted) {
  options.states = StateSelection::all;
  options.interrupted = std::move(interrupted);
  return solve(scene, backend, options);
}

Options to_tolerance(double tolerance) {
  Options options;
  options.tolerance = tolerance;
  return options;
}

Options on_grid(Method method, Index steps) {
  Options options;
  options.method = method;
  options.steps = steps;
  return options;
}

void add_examples(const std::filesystem::path& folder, std::vector<Case>& all) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (entry.path().extension() == ".toml") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  for (const auto& [words, tolerance] : {std::pair{"default", 0.0}, {"tol=1e-4", 1e-4}})
    for (const auto& file : files)
      all.push_back({"examples/" + file.stem().string() + "/" + words,
                     [file, tolerance = tolerance](Backend& backend, std::function<bool()> interrupted) {
                       const SceneFile read = read_scene_file(file);
                       return solve_with_states(read.scene, backend, to_tolerance(tolerance), std::move(interrupted));
                     }});
}

void add_hard_cases(std::vector<Case>& all) {
  for (app::HardCase& hard : app::hard_cases(false)) {
    const auto one = std::make_shared<const app::HardCase>(std::move(hard));
    all.push_back(
        {"hard/" + one->group + ": " + one->name + "/tol", [one](Backend& backend, std::function<bool()> interrupted) {
           Options options = to_tolerance(one->tolerance);
           options.states = one->components.empty() ? StateSelection::all : StateSelection::list;
           options.components = one->components;
           options.interrupted = std::move(interrupted);
           return solve(one->scene, backend, options);
         }});
  }
}

void add_random_scenes(std::uint32_t count, std::vector<Case>& all) {
  constexpr std::array methods{Method::automatic, Method::march, Method::contour, Method::euler};
  for (std::uint32_t seed = 0; seed < count; ++seed)
    for (const Method method : methods)
      all.push_back({text("random/%u/%s", seed, to_string(method)),
                     [seed, method](Backend& backend, std::function<bool()> interrupted) {
                       const oracle::RandomScene random = oracle::any_scene(seed);
                       return solve_with_states(random.scene, backend, on_grid(method, random.steps),
                                                std::move(interrupted));
                     }});
}

void add_scenes_with_sources(std::uint32_t count, std::vector<Case>& all) {
  const std::array<std::pair<const char*, Options>, 3> ways{{{"tol=1e-3", to_tolerance(1e-3)},
                                                             {"steps=100", on_grid(Method::automatic, 100)},
                                                             {"steps=400", on_grid(Method::automatic, 400)}}};
  for (std::uint32_t seed = 0; seed < count; ++seed)
    for (const auto& [words, options] : ways)
      all.push_back({text("sources/%u/%s", seed, words),
                     [seed, options = options](Backend& backend, std::function<bool()> interrupted) {
                       return solve_with_states(oracle::source_scene(seed).scene, backend, options,
                                                std::move(interrupted));
                     }});
}

}  // namespace

std::vector<Case> cases(const Selection& selection) {
  std::vector<Case> all;
  if (!selection.examples.empty()) add_examples(selection.examples, all);
  if (selection.hard) add_hard_cases(all);
  add_random_scenes(selection.random, all);
  add_scenes_with_sources(selection.sources, all);
  return all;
}

}  // namespace bromwich::frozen

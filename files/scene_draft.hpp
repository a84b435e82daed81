#pragma once
// The scene that the sections of a file state.

#include "core/scene/scene.hpp"
#include "files/sections.hpp"

#include <memory>

namespace bromwich {

struct Mechanism;

/// A scene under construction, and the switch times of its sources.
struct Draft {
  Scene scene;
  SwitchTimes switches;
  Index sources = 0;                                ///< equal numbers: the same f, g and switch times
  std::shared_ptr<const Mechanism> mechanism = {};  ///< of [structure]

  void note(const SwitchTimes& of_source) {
    switches.times.insert(switches.times.end(), of_source.times.begin(), of_source.times.end());
    switches.complete = switches.complete && of_source.complete;
  }
};

/// `settings`: T and steps, in place of those of the file. Its parameters are defined.
Draft draft_scene(const Sections&, const ParameterValues& settings);

}  // namespace bromwich

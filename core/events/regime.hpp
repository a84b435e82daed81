#pragma once
// A scene in one mode of each of its memories, as located events take it.

#include "../scene/memory_rows.hpp"
#include "event_sources.hpp"
#include "switched_system.hpp"

#include <memory>
#include <utility>
#include <vector>

namespace bromwich {

struct Regime {
  std::vector<Index> modes;  ///< none: the scene has no memories
  const Scene scene;
  const SystemMatrices system;
  const EventSources sources;

  /// `looks`: those of the scene, or null.
  Regime(const Scene& all, std::vector<Index> in, const std::shared_ptr<SourceLooks>& looks = {})
      : modes(std::move(in)),
        scene(modes.empty() ? all : in_modes(all, modes)),
        system(switched_system(scene, guards(all))),
        sources(scene, looks_in(looks, modes)) {}
  Regime(const Regime&) = delete;
  Regime& operator=(const Regime&) = delete;

 private:
  static std::shared_ptr<SourceLooks> looks_in(const std::shared_ptr<SourceLooks>& looks,
                                               const std::vector<Index>& modes) {
    if (!looks || modes.empty()) return looks;
    std::shared_ptr<SourceLooks>& own = looks->in_modes[modes];
    if (!own) own = std::make_shared<SourceLooks>();
    return own;
  }
};

}  // namespace bromwich

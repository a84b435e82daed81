#include "app/memory_output.hpp"

#include "core/scene/memory.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace bromwich::app {

namespace {

const std::string& start_of(const Memory& memory) {
  return memory.start.empty() ? memory.modes.front().name : memory.start;
}

std::string mode_text(const Memory::Mode& mode) {
  std::vector<std::string> next;
  for (const Memory::Leave& leave : mode.leave)
    if (std::find(next.begin(), next.end(), leave.to) == next.end()) next.push_back(leave.to);
  return next.empty() ? mode.name + " (stays)" : fmt::format("{} (to {})", mode.name, fmt::join(next, ", "));
}

}  // namespace

std::vector<std::string> memory_facts(const Scene& scene) {
  std::vector<std::string> facts;
  for (const Memory& memory : scene.memories) {
    std::vector<std::string> modes;
    for (const Memory::Mode& mode : memory.modes) modes.push_back(mode_text(mode));
    facts.push_back(fmt::format("{}: {}; begins with {}", memory.name, fmt::join(modes, ", "), start_of(memory)));
  }
  return facts;
}

std::string memory_line(const Scene& scene, const Result& result) {
  std::vector<std::string> parts;
  for (std::size_t k = 0; k < scene.memories.size(); ++k) {
    const Memory& memory = scene.memories[k];
    const auto changes = std::count_if(result.mode_changes.begin(), result.mode_changes.end(),
                                       [&](const ModeChange& c) { return c.memory == Index(k); });
    std::string part = fmt::format("{} {} change{}", memory.name, changes, changes == 1 ? "" : "s");
    const bool known = result.modes.cols() > Index(k) && result.modes.rows() > 0;
    if (const double last = known ? result.modes(result.modes.rows() - 1, Index(k)) : -1; last >= 0)
      part += fmt::format(", {} at T", memory.modes[std::size_t(last)].name);
    parts.push_back(std::move(part));
  }
  return fmt::format("{}", fmt::join(parts, "; "));
}

Json memories_json(const Scene& scene) {
  Json all = Json::array();
  for (const Memory& memory : scene.memories) {
    Json modes = Json::array();
    for (const Memory::Mode& mode : memory.modes) modes.push_back(mode.name);
    all.push_back({{"name", memory.name}, {"modes", modes}, {"start", start_of(memory)}});
  }
  return all;
}

Json memories_json(const Scene& scene, const Result& result) {
  Json all = memories_json(scene);
  for (std::size_t k = 0; k < scene.memories.size(); ++k) {
    all[k]["changes"] = Json::array();
    const bool known = result.modes.rows() > 0 && result.modes.cols() > Index(k) && result.modes(0, Index(k)) >= 0;
    if (known) all[k]["start"] = scene.memories[k].modes[std::size_t(result.modes(0, Index(k)))].name;
  }
  for (const ModeChange& c : result.mode_changes) {
    const Memory& memory = scene.memories[std::size_t(c.memory)];
    all[std::size_t(c.memory)]["changes"].push_back(
        {{"t", c.t}, {"from", memory.modes[std::size_t(c.from)].name}, {"to", memory.modes[std::size_t(c.to)].name}});
  }
  return all;
}

}  // namespace bromwich::app

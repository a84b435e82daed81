#include "core/scene/memory.hpp"

#include "core/base/require.hpp"
#include "core/dynamics/dynamics.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>
#include <utility>

namespace bromwich {

namespace {

using Condition = Memory::Condition;

Condition beside(Index i, double sign, double value, Index m) {
  return {.x = sign * Vector::Unit(m, i),
          .time = [offset = -sign * value](double, Eigen::Ref<Vector> e) { e[0] = offset; }};
}

// For messages: memories[0].modes[1].
std::string place_of(std::size_t memory) { return "memories[" + std::to_string(memory) + "]"; }
std::string place_of(std::size_t memory, std::size_t mode) {
  return place_of(memory) + ".modes[" + std::to_string(mode) + "]";
}

std::string names_of(const Memory& memory) {
  std::string all;
  for (const Memory::Mode& mode : memory.modes) all += (all.empty() ? "" : ", ") + mode.name;
  return all;
}

void validate_function(const std::string& where, const TimeFunction& function, Index length) {
  if (!function) return;
  Vector value = Vector::Constant(length, NAN);
  function(0.0, value);
  require_finite(where + "(0)", value);
}

void validate(const Memory::Leave& leave, const Memory& memory, const std::string& where, const Scene& scene) {
  const Index m = scene.states(), n = scene.constraints(), with_modes = m + Index(scene.memories.size());
  if (mode_named(memory, leave.to) < 0)
    throw Error(where + ".to", "found '" + leave.to + "'", "the modes of " + memory.name + " are " + names_of(memory));
  require_some(where + ".when", Index(leave.when.size()), "condition");
  for (const Condition& c : leave.when) {
    if (c.x.size() > 0 && c.x.size() != with_modes) require_length(where + ".when.x", c.x, m, "one per state");
    if (c.y.size() > 0) require_length(where + ".when.y", c.y, n, "one per constraint");
    require_finite(where + ".when.x", c.x);
    require_finite(where + ".when.y", c.y);
    validate_function(where + ".when.time", c.time, 1);
  }
  for (const Memory::Jump& jump : leave.set)
    if (jump.state < 0 || jump.state >= m || !std::isfinite(jump.value))
      throw Error(where + ".set", "sets state " + std::to_string(jump.state) + " to " + text("%g", jump.value),
                  "give a finite value of a state from 0, below " + std::to_string(m));
}

void validate(const Memory& memory, std::size_t k, const Scene& scene) {
  const Index m = scene.states(), n = scene.constraints();
  require_some(place_of(k) + ".modes", Index(memory.modes.size()), "mode");
  if (!memory.start.empty() && mode_named(memory, memory.start) < 0)
    throw Error(place_of(k) + ".start", "found '" + memory.start + "'",
                "the modes of " + memory.name + " are " + names_of(memory));
  std::set<std::string> names;
  for (std::size_t i = 0; i < memory.modes.size(); ++i)
    if (const std::string& name = memory.modes[i].name; name.empty() || !names.insert(name).second)
      throw Error(place_of(k, i) + ".name", "found '" + name + "'", "give every mode a name of its own");
  for (std::size_t i = 0; i < memory.modes.size(); ++i) {
    const Memory::Mode& mode = memory.modes[i];
    const std::string where = place_of(k, i);
    validate_function(where + ".f", mode.f, m);
    validate_function(where + ".g", mode.g, n);
    for (const auto& [name, matrix, rows, columns] :
         {std::tuple("A", &mode.A, m, m), {"B", &mode.B, m, n}, {"N", &mode.N, n, m}, {"M", &mode.M, n, n}}) {
      if (matrix->size() > 0) require_shape(where + "." + name, *matrix, rows, columns, "that of the scene");
      require_finite(where + "." + name, *matrix);
    }
    for (std::size_t l = 0; l < mode.leave.size(); ++l)
      validate(mode.leave[l], memory, where + ".leave[" + std::to_string(l) + "]", scene);
  }
}

}  // namespace

Memory::Condition Memory::above(Index i, double value, Index m) { return beside(i, 1, value, m); }
Memory::Condition Memory::below(Index i, double value, Index m) { return beside(i, -1, value, m); }

Index mode_named(const Memory& memory, const std::string& name) {
  for (std::size_t i = 0; i < memory.modes.size(); ++i)
    if (memory.modes[i].name == name) return Index(i);
  return -1;
}

std::vector<Index> modes_at_start(const Scene& scene) {
  std::vector<Index> modes;
  for (const Memory& memory : scene.memories)
    modes.push_back(memory.start.empty() ? 0 : mode_named(memory, memory.start));
  return modes;
}

void validate_memories(const Scene& scene) {
  if (scene.memories.empty()) return;
  if (!scene.dynamics->small_state() || !scene.free_rows.empty())
    throw Error("memories", "need dense dynamics without free rows", "write A, B and N as matrices");
  std::set<std::string> names;
  for (std::size_t k = 0; k < scene.memories.size(); ++k) {
    const Memory& memory = scene.memories[k];
    if (memory.name.empty() || !names.insert(memory.name).second)
      throw Error(place_of(k) + ".name", "found '" + memory.name + "'", "give every memory a name of its own");
    validate(memory, k, scene);
  }
}

void for_each_source(const Scene& scene, const std::function<void(const TimeFunction&, Index)>& visit) {
  visit(scene.f, scene.sources());
  visit(scene.g, scene.constraints());
  for (const Memory& memory : scene.memories)
    for (const Memory::Mode& mode : memory.modes) {
      visit(mode.f, scene.states());
      visit(mode.g, scene.constraints());
      for (const Memory::Leave& leave : mode.leave)
        for (const Condition& c : leave.when) visit(c.time, 1);
    }
}

void change_each_source(Scene& scene, const std::function<TimeFunction(TimeFunction)>& changed) {
  const auto change = [&](TimeFunction& source) {
    if (source) source = changed(std::move(source));
  };
  change(scene.f);
  change(scene.g);
  for (Memory& memory : scene.memories)
    for (Memory::Mode& mode : memory.modes) {
      change(mode.f);
      change(mode.g);
      for (Memory::Leave& leave : mode.leave)
        for (Condition& c : leave.when) change(c.time);
    }
}

}  // namespace bromwich

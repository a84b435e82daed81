#pragma once
// The memories of a scene as they are stated: their checks, names and sources.

#include "../base/time_function.hpp"
#include "bromwich/scene.hpp"

#include <functional>
#include <string>
#include <vector>

namespace bromwich {

/// Throws Error naming what is wrong: "memories[0].modes[1].leave[0].to".
void validate_memories(const Scene&);

/// The number of a mode; -1: there is none.
Index mode_named(const Memory&, const std::string&);
/// The modes at t = 0, one of each memory.
std::vector<Index> modes_at_start(const Scene&);

/// f and g of the scene and of all modes, and the functions of conditions, with their numbers of values.
void for_each_source(const Scene&, const std::function<void(const TimeFunction&, Index)>&);
void change_each_source(Scene&, const std::function<TimeFunction(TimeFunction)>&);

}  // namespace bromwich

#pragma once
// [[memory]] of a scene file: elements with memory.

#include "files/scene_draft.hpp"

namespace bromwich {

/// Adds the memories of the file to the scene of the draft, which has its names, and notes the switch times of their
/// sources and conditions.
void add_memories(const Sections&, Draft&);

}  // namespace bromwich

#pragma once
// Scenes with memories, in given modes and with the rows that watch their conditions.

#include "memory.hpp"
#include "scene.hpp"

#include <map>
#include <vector>

namespace bromwich {

/// The scene while its memories are in these modes, without memories.
Scene in_modes(const Scene&, const std::vector<Index>& modes);

/// The same by rows of Result::modes, each made once.
class ScenesInModes {
 public:
  /// The scene has to outlive the object.
  explicit ScenesInModes(const Scene& scene) : scene_(scene) {}
  /// The scene itself where it has no memories, or the modes are not known.
  const Scene& at_row(const RowMatrix& modes, Index row);

 private:
  const Scene& scene_;
  std::map<std::vector<Index>, Scene> made_;
};

/// The scene with the numbers of the modes as states behind its own, x' = 0, and behind its rows a guard for each
/// condition that a mode may have: a row w_i that falls below 0 where the condition holds, and that other rows and the
/// state do not see. Precondition: there are memories, and the dynamics are dense.
Scene with_memory_rows(const Scene&);
/// Of such a scene: the modes of a state.
std::vector<Index> modes_at(const Scene&, const Vector& x);

}  // namespace bromwich

#pragma once

#include "scene.hpp"

#include <vector>

namespace bromwich {

/// A scene without constraints with one that never acts, 0 <= y ⊥ y >= 0.
Scene with_idle_constraint(Scene);

/// A and E^{-1} B, as make_scene writes them. E must be regular. Throws Error where E is not diagonal and A has more
/// than 5e7 entries.
struct StateSpace {
  SparseMatrix A, F;
};
StateSpace state_space(const PortHamiltonian&);

/// The limit at a time from the left or from the right.
enum class Side { before, behind };

/// Times in (0, T) where u jumps: those given, and those found by halving the intervals of `samples` in which u changes
/// more than twice as much as beside them. Two jumps between three samples are not seen, nor one smaller than what u
/// changes otherwise.
std::vector<double> input_jumps(const PortHamiltonian&, double T, Index samples = 1000);

}  // namespace bromwich

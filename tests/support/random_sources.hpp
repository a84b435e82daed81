#pragma once
// Small random scenes with typical engineering sources: square waves, pulses, tables, steps, fast sines. Everything is
// smooth between breakpoints, so tests/support/oracle_events.hpp can solve them.

#include "tests/support/oracle_events.hpp"
#include "tests/support/random_scenes.hpp"

#include <string>

namespace bromwich::oracle {

struct SourceScene {
  Scene scene;      ///< in its own units
  EventScene base;  ///< the same in natural units: x = unit_x times x of `base`, and so on
  double unit_x = 1, unit_y = 1, unit_t = 1;
  bool told = false;  ///< the scene declares its breakpoints
  Family family;
  Spectrum spectrum;
  std::string sources;  ///< kinds of sources, separated by commas
};

/// 1 to 4 states, 1 to 3 constraints; the family is number seed % families. Every second scene declares its
/// breakpoints.
SourceScene source_scene(std::uint32_t seed);

/// The scene with sparse dynamics, and `m` states in all: more ones that decay, which nothing drives or sees.
Scene among_sparse_states(const Scene&, Index m);

}  // namespace bromwich::oracle

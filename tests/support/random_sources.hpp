#pragma once
// Small random scenes with every kind of source that engineers write: square waves, pulses, tables, steps, fast sines.
// All that happens in them between breakpoints is smooth, so that tests/support/oracle_events.hpp can solve them.

#include "tests/support/oracle_events.hpp"
#include "tests/support/random_scenes.hpp"

#include <string>

namespace bromwich::oracle {

struct SourceScene {
  Scene scene;      ///< in units of its own
  EventScene base;  ///< the same in natural units: x = unit_x * that of `base`, and so on
  double unit_x = 1, unit_y = 1, unit_t = 1;
  bool told = false;  ///< the scene names its breakpoints
  Family family;
  Spectrum spectrum;
  std::string sources;  ///< kinds, with commas
};

/// 1 to 4 states, 1 to 3 constraints; the family is that of seed % families. Every second scene names its breakpoints.
SourceScene source_scene(std::uint32_t seed);

}  // namespace bromwich::oracle

#pragma once
// Whether the steps of a grid resolve f and g. A source that goes up and down within a few steps is far from the
// straight line between the ends of a step. For a sine with k steps a period the distance is 1 - cos(pi/k) of its size,
// 0.29 for k = 4. Whatever a method makes of the source inside a step, y is linear there or has one or two values.

#include "scene.hpp"

namespace bromwich {

struct CoarseSources {
  double missed = 0;  ///< largest distance from the straight line that was seen, relative to the size of the component
  double time = 0;    ///< where
};

/// Samples a few steps at irregular places, and more steps where one of them is coarse. Steps with a breakpoint, and
/// those in which the source jumps, do not count: methods find them. Empty unless one sample of eight misses more than
/// 0.15 of the size.
CoarseSources find_coarse_sources(const Scene&, const Vector& t);

}  // namespace bromwich

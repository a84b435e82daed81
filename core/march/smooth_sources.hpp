#pragma once
// Sources on a part of a step.

#include "../base/types.hpp"

namespace bromwich {

/// f and g on a part of a step where both are smooth: columns of 1, s, s^2 with the time s from `begin`.
struct SmoothSources {
  double begin = 0, length = 0;
  Matrix f, g;          ///< m x 3 and n x 3
  bool breaks = false;  ///< g or its slope may jump at `begin`
};

}  // namespace bromwich

#pragma once
// The catalogue of hard cases of `bromwich bench stability`. Most solutions are manufactured: x, y and w are chosen,
//
//     f = x' - A x - B y,   g = w - N x - M y,   y = max(S, 0),   w = max(-S, 0),
//
// so the solution is known for any A, B, N and M. The others are solved by hand.

#include "core/scene/scene.hpp"

#include <cmath>

#include <string>
#include <vector>

namespace bromwich::app {

struct HardCase {
  std::string group, name, reference;
  Scene scene;  ///< with `exact`; right limits at jumps
  std::string expected = "solved";
  double until = INFINITY;             ///< compared up to here
  bool compare_y = true;               ///< false if y is not unique
  bool y_jumps = false;                ///< then its mean over [0, t] is compared
  Vector impulse = {};                 ///< part of the integral of y at t = 0
  std::vector<Index> components = {};  ///< of x to record; empty = all
  double tolerance = 1e-3;
};

/// Those of --quick are small.
std::vector<HardCase> hard_cases(bool quick);

}  // namespace bromwich::app

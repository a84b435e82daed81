#pragma once

#include "../base/types.hpp"

namespace bromwich {

/// Milliseconds that a whole solve takes, for n constraints and J steps of a Kronecker sum with M of class P; null
/// where nothing is known.
using Milliseconds = double (*)(double n, double J);

/// What a backend is good at. Methods are chosen by it, and the sizes of their grids.
struct BackendTraits {
  Index fewest_steps = 16;    ///< of a coarse time grid: a shorter one takes as long
  Index unpolled_steps = 0;   ///< of a march that is over before anybody would interrupt it
  bool one_at_a_time = true;  ///< a single small problem is no waste: it can march where it can iterate
  double start_seconds = 0;   ///< that a process spends before it first uses the device
  double fewest_values = 0;   ///< n J: below it, methods that solve all time points at once are not worth a device
  Milliseconds march = nullptr, contour = nullptr, multigrid = nullptr;
};

}  // namespace bromwich

#pragma once

#include "../base/types.hpp"

namespace bromwich {

/// Milliseconds of a whole solve with n constraints and J steps of a Kronecker sum, M of class P; null if unknown.
using Milliseconds = double (*)(double n, double J);

/// Performance data of a backend, used to choose methods and sizes of time grids.
struct BackendTraits {
  Index fewest_steps = 16;    ///< of a coarse time grid; a shorter one takes as long
  Index unpolled_steps = 0;   ///< marches up to this length end too soon to be worth an interruption
  bool one_at_a_time = true;  ///< true: efficient on a single small problem, so it can march instead of iterate
  double start_seconds = 0;   ///< start-up time of the device, once per process
  double fewest_values = 0;   ///< n J; below it, methods over all time points do not pay on a device
  Milliseconds march = nullptr, contour = nullptr, multigrid = nullptr;
  /// The same with contact on a face of a box, n its points.
  Milliseconds face_march = nullptr, face_contour = nullptr, face_multigrid = nullptr;
};

}  // namespace bromwich

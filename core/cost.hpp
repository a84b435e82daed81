#pragma once
// What a method will take, before it runs: m states, n constraints, J steps, c state components, k source functions.

#include "solve.hpp"

namespace bromwich {

struct Cost {
  double bytes = 0;       ///< memory at its largest, within a factor of about two
  double operations = 0;  ///< floating-point multiplications, order of magnitude (an iteration: for 100 sweeps)
  std::string largest;    ///< what most of the memory is for
};

/// For a named method; `automatic` stands for march.
Cost predicted_cost(const Scene&, Method, Index J, Index components, int threads = 1);

/// A system that hands out memory it does not have kills a run half-way without a word: throws Error with the numbers
/// where the cost of the method is beyond options.memory_limit, or beyond 10^16 operations (weeks). For `automatic`,
/// only where no method fits.
void refuse_what_does_not_fit(const Scene&, const Options&, Index J, Index components, int threads = 1);

}  // namespace bromwich

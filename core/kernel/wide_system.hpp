#pragma once
// The dynamics with all inputs and outputs of a solve side by side, so that one batch of shifted solves serves them
// all: [N; I_c] (zE - A)^{-1} [B F E x0].

#include "discrete_problem.hpp"

#include <vector>

namespace bromwich {

/// [B F E x0] and [N; I_c].
struct Wide {
  Dynamics dynamics;
  Index n = 0, sources = 0, states = 0, components = 0;  ///< sources: of phi; states: 1 with x0, else 0

  Index lag_inputs() const { return n + sources; }
  Index inputs() const { return n + sources + states; }
  Index outputs() const { return n + components; }
};

/// Throws Error if f is given per state and there are too many states.
Wide widen(const DiscreteProblem&, const std::vector<Index>& components);

}  // namespace bromwich

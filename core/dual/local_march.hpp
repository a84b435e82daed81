#pragma once
// A V without memory of its own: every state is constrained, M = 0, and N and B are diagonal with positive products.
// Then V^(z) = B^{-1} (z I - A) N^{-1} is local in time, cycles have nothing to do, and the steps are marched in w: the
// problem of a step,
//
//     0 <= w  ⊥  y = B^{-1} ((a^{-1}/h ⊗ I - I ⊗ A) X - (known terms)) >= 0,   w = N X + g at both stages of Radau IIA,
//
// has the sparse matrix of the dynamics, where marching in y has the full matrix W_0. Examples are obstacle problems
// and options with early exercise.

#include "../kernel/prepared_method.hpp"
#include "../kernel/time_operator.hpp"

#include <memory>

namespace bromwich {

/// Whether V is local here and steps in w apply: many states as matrices, without a mass matrix, and smooth sources.
bool has_local_inverse(const DiscreteProblem&);
/// The same without a test of the sources.
bool has_local_inverse(const Scene&);

/// Marches in w; the states are known afterwards. Precondition: has_local_inverse. The problem must outlive it.
std::unique_ptr<PreparedMethod> prepare_local_march(const DiscreteProblem&);

}  // namespace bromwich

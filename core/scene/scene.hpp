#pragma once
// Scenes that are made from another one.

#include "../base/time_function.hpp"
#include "../dynamics/dynamics.hpp"
#include "../lcp/matrix.hpp"
#include "bromwich/scene.hpp"

namespace bromwich {

/// The scene with A, B, N and E as dense matrices, see to_dense.
Scene written_out(Scene);

/// The scene on [t, t + length] alone, from the state x, with its clock set back to 0.
Scene part_of(const Scene&, double t, double length, const Vector& x);

/// Rows that only watch, the last ones: see with_memory_rows. 0 without memories.
Index guards(const Scene&);

/// F with f = F phi, m x sources(). Precondition: the dynamics of the scene are these.
Matrix source_matrix(const Scene&, const DenseDynamics&);

}  // namespace bromwich

#pragma once
// Implicit Euler of Siconos on a scene, by the program of bench/peers/siconos_loop.cpp.

#include "core/result/result.hpp"
#include "core/scene/scene.hpp"

#include <string>
#include <vector>

namespace bromwich::app {

/// True if Siconos takes the scene: initial values, no free rows, no mass matrix, dense or sparse matrices.
bool fits_siconos(const Scene& scene);

/// Implicit Euler on J equal steps in a process of its own. The result has y and the `components` of x (all if empty)
/// at the ends of the steps; row 0 holds x0 and no y. Its status is `solved` if every LCP ended without a failure,
/// `tolerance_not_met` otherwise, and `nonfinite` if the process did not end well. Sources are sampled before the
/// clock starts. Precondition: fits_siconos. Throws Error if the temporary files cannot be written.
Result siconos_euler(const std::string& program, const Scene& scene, const std::vector<Index>& components, Index J);

}  // namespace bromwich::app

#pragma once

#include "../result/inner_options.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "../seam/backend.hpp"

namespace bromwich {

/// Solves a scene with initial values and constraints, without free rows, on the grid of the options, by their method
/// or, for Method::automatic, by the first of several that solves it.
Result solve_on_one_grid(const Scene&, Backend&, const InnerOptions&);

}  // namespace bromwich

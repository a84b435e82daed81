#pragma once

#include "../result/inner_options.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "../seam/backend.hpp"

namespace bromwich {

/// A scene in its simplest form (reductions.hpp) on one grid: no tolerance, and no method that solves whole scenes.
Result solve_on_steps(const Scene&, Backend&, const InnerOptions&);

}  // namespace bromwich

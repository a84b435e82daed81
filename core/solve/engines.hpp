#pragma once
// The methods by what they take: whole scenes, or one grid after the other.

#include "../result/inner_options.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "../seam/backend.hpp"

namespace bromwich {

/// `solve` for a scene and options that are valid already.
Result solve_valid(const Scene&, Backend&, const InnerOptions&);

/// A scene in its simplest form (reductions.hpp), with a tolerance or on given steps.
Result solve_reduced(const Scene&, Backend&, const InnerOptions&);

}  // namespace bromwich

#pragma once
// A solve is a row of stages. Each one passes, or gives the result: by what it does itself, or from a simpler scene
// that it hands back to `solve`, to go through the stages from the first one on.

#include "../result/inner_options.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "../seam/backend.hpp"

#include <functional>
#include <optional>

namespace bromwich {

/// The whole row; what a stage solves simpler scenes with.
using Solve = std::function<Result(const Scene&, Backend&, const InnerOptions&)>;

using Stage = std::optional<Result> (*)(const Scene&, Backend&, const InnerOptions&, const Solve&);

}  // namespace bromwich

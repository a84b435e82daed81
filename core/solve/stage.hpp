#pragma once
// A solve is a list of stages. Each stage either passes on to the next one or returns the result. It may solve a
// simpler scene by `solve`, which starts with the first stage again.

#include "../result/inner_options.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "../seam/backend.hpp"

#include <functional>
#include <optional>

namespace bromwich {

/// All stages, for a simpler scene.
using Solve = std::function<Result(const Scene&, Backend&, const InnerOptions&)>;

using Stage = std::optional<Result> (*)(const Scene&, Backend&, const InnerOptions&, const Solve&);

}  // namespace bromwich

#pragma once

#include "../result/options.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "../seam/backend.hpp"

#include <string>

namespace bromwich {

/// The result of a scene that was not solved: rows of NaN.
Result unsolved(const Scene&, const Backend&, const Options&, Status, const std::string& why);

}  // namespace bromwich

#pragma once

#include "app/reference_error.hpp"
#include "app/scene_choice.hpp"
#include "core/result/result.hpp"

#include <string>

namespace bromwich::app {

/// The text output of `solve`: about ten aligned lines. `out` names the written files, or is empty; `method`
/// is another word for the method, or empty.
std::string summary(const SceneChoice& choice, const Result& result, int threads, const ReferenceError& error,
                    const std::string& out, const std::string& method = "");

}  // namespace bromwich::app

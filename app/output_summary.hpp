#pragma once

#include "app/scene_choice.hpp"
#include "core/result.hpp"

#include <string>

namespace bromwich::app {

/// What `solve` prints for people: about ten aligned lines. `out` is the file that was written, or empty.
std::string summary(const SceneChoice& choice, const Result& result, int threads, const std::string& out);

}  // namespace bromwich::app

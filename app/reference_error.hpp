#pragma once

#include "app/scene_choice.hpp"
#include "core/result/result.hpp"
#include "core/seam/backend.hpp"

#include <optional>

namespace bromwich::app {

/// Largest absolute errors; empty where nothing was compared.
struct ReferenceError {
  std::optional<double> x, y;
};

/// x and y each against the known values of [reference] at its time, linear between the time points beside it; without
/// such values against the exact solution at all valid time points. Of x, only what was computed is compared with the
/// exact solution; for [reference] the missing states are computed where that takes a few shifted solves.
ReferenceError reference_error(const SceneChoice& choice, Backend& backend, const Result& result);

/// Whether there is anything to compare with.
bool has_reference(const SceneChoice& choice);

}  // namespace bromwich::app

#pragma once

#include "app/scene_choice.hpp"
#include "core/result/result.hpp"
#include "core/seam/backend.hpp"

#include <optional>

namespace bromwich::app {

/// Largest absolute errors; empty if nothing was compared.
struct ReferenceError {
  std::optional<double> x, y;
};

/// Compares x and y each with the values of [reference] at its time, by linear interpolation between time points;
/// without such values, with the exact solution at all valid time points. Only computed components of x are compared
/// with the exact solution; for [reference], missing states are computed if that takes only a few shifted solves.
ReferenceError reference_error(const SceneChoice& choice, Backend& backend, const Result& result);

/// Whether there are values for a comparison.
bool has_reference(const SceneChoice& choice);

}  // namespace bromwich::app

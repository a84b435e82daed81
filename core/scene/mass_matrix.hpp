#pragma once
// E x' = A x + B y + f with a regular E as x' = E^{-1} A x + E^{-1} B y + E^{-1} f.

#include "scene.hpp"

#include <optional>

namespace bromwich {

/// The scene without E where that costs no sparsity: dense and diagonal E. Nothing for others. Precondition: E is
/// regular.
std::optional<Scene> without_mass(const Scene&);

}  // namespace bromwich

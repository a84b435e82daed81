#pragma once
// E x' = A x + B y + f with a regular E as x' = E^{-1} A x + E^{-1} B y + E^{-1} f.

#include "scene.hpp"

#include <optional>

namespace bromwich {

/// E is singular to rounding; of a dense E rows and columns are made comparable first. Supplied dynamics: not looked
/// at.
bool has_singular_mass(const Dynamics&);

/// The scene without E where that costs no sparsity: dense and diagonal E. Nothing for others. Precondition: E is
/// regular.
std::optional<Scene> without_mass(const Scene&);

}  // namespace bromwich

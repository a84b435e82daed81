#pragma once
// E x' = A x + B y + f with a regular E as x' = E^{-1} A x + E^{-1} B y + E^{-1} f.

#include "scene.hpp"

#include <optional>
#include <string>

namespace bromwich {

/// The scene without E where that costs no sparsity: dense and diagonal E. Nothing for others. Precondition: E is
/// regular.
std::optional<Scene> without_mass(const Scene&);

/// What a singular E is and what to do, one line: a node that no element has (a row of zeros in E and A), zE - A
/// singular for all z, an algebraic equation (a row of zeros in E). Precondition: E is singular.
std::string describe_singular_mass(const LinearSystem&);

}  // namespace bromwich

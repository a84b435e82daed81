#pragma once

#include "core/scene/scene.hpp"

#include <vector>

namespace bromwich::app {

/// Heat in the unit square by second differences on G x G inner points, diffusivity 1, 0 at its sides: point i of
/// `points` (its row times G and its column) has a source y_i, a unit per area of a cell, and its temperature is seen.
SparseDynamics heat_on_a_square(Index G, const std::vector<Index>& points);

}  // namespace bromwich::app

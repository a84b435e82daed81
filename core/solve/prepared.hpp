#pragma once
// What a Solver keeps from one solve to the next.

#include "../scene/natural_units.hpp"
#include "../scene/scene.hpp"
#include "methods.hpp"

#include <memory>
#include <optional>

namespace bromwich {

struct Prepared {
  std::optional<NaturalUnits> units;  ///< of the first solve, used by all later ones
  std::unique_ptr<Scene> scene;       ///< that the methods are for, in natural units
  std::unique_ptr<Methods> methods;
};

}  // namespace bromwich

#pragma once
// What a Solver keeps from one solve to the next.

#include "../scene/natural_units.hpp"
#include "../scene/scene.hpp"
#include "cost.hpp"
#include "methods.hpp"

#include <memory>
#include <optional>

namespace bromwich {

struct Prepared {
  std::optional<NaturalUnits> units;  ///< of the first solve, used by all later ones
  const Scene* stated = nullptr;      ///< the scene of the Solver
  Changes changes = no_changes;       ///< of it, that the methods have not got yet
  std::unique_ptr<Scene> scene;       ///< that the methods are for, in natural units say; null: it is the stated one
  std::unique_ptr<Methods> methods;
  Cost cost;                    ///< predicted for them
  bool finite_sources = false;  ///< those of the methods; false: not known
};

}  // namespace bromwich

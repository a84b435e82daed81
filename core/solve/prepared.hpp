#pragma once
// Data that a Solver keeps from one solve to the next.

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
  Changes changes = no_changes;       ///< of `stated` since the last run of the methods
  std::unique_ptr<Scene> scene;       ///< scene of the methods, for example in natural units; null: `stated`
  std::unique_ptr<Methods> methods;
  Cost cost;                    ///< predicted for the methods
  bool finite_sources = false;  ///< the sampled sources are finite; false: not known
};

}  // namespace bromwich

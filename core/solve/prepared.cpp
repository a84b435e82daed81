#include "core/solve/prepared.hpp"

#include <utility>

namespace bromwich {

const NaturalUnits& Prepared::units_of_solve(const std::function<NaturalUnits()>& now) {
  if (units && !units_may_change) return *units;
  NaturalUnits found = now();
  if (units && !same_units(*units, found)) {
    grids.clear();
    reduced_.clear();
  }
  return units.emplace(std::move(found));
}

Dynamics Prepared::reduced(ReducedDynamics reduction, const Dynamics& given, const Dynamics& made) {
  const auto found = reduced_.find(reduction);
  if (found != reduced_.end() && &*found->second.first == &*given) return found->second.second;
  reduced_.insert_or_assign(reduction, std::pair(given, made));
  return made;
}

const EliminatedScene* Prepared::without_free_rows(const Scene& scene) {
  if (eliminated_from_ != &scene) {
    eliminated_ = eliminate_free(scene);
    if (eliminated_)
      eliminated_->scene.dynamics = reduced(ReducedDynamics::free_rows, scene.dynamics, eliminated_->scene.dynamics);
    eliminated_from_ = &scene;
  }
  return eliminated_ ? &*eliminated_ : nullptr;
}

}  // namespace bromwich

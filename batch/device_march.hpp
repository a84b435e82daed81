#pragma once
// Scenes of a plan on a backend that steps many of them at a time (core/seam/scene_march.hpp).

#include "../core/seam/scene_march.hpp"
#include "lane_plan.hpp"

namespace bromwich {

/// The maps of all active sets.
StoredSets stored_sets(const ActiveSetTable&);

/// What the backend needs of a plan. Precondition: no step is taken in parts.
SceneMarchProblem scene_march_problem(const LanePlan&);

}  // namespace bromwich

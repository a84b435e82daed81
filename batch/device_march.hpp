#pragma once
// Scenes of a plan on a backend that steps many of them at a time (core/seam/scene_march.hpp).

#include "../core/seam/scene_march.hpp"
#include "lane_plan.hpp"

namespace bromwich {

/// The maps of all active sets.
StoredSets stored_sets(const ActiveSetTable&);

/// What the backend needs of a plan that scenes share. Precondition: no step is taken in parts.
SceneMarchProblem shared_march_problem(const LanePlan&);

/// The same of plans of one kind, each of one scene; this is one of them. Precondition: no search for other solutions.
SceneMarchProblem own_march_problem(const LanePlan&, const SourceSamples&);
void write_plan(const LanePlan&, const scene_steps::PlanLayout&, double* row);

}  // namespace bromwich

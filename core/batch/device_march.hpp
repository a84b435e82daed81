#pragma once
// Scenes of a plan on a backend that steps many of them at a time (core/seam/scene_march.hpp).

#include "../seam/scene_march.hpp"
#include "lane_march.hpp"

namespace bromwich {

/// What the backend needs of a plan. Precondition: no step is taken in parts.
SceneMarchProblem scene_march_problem(const LanePlan&);

/// y_0 of a scene from x0 and g(0), both in the units of the plan.
struct LaneStart {
  bool found = false;          ///< the problem at t = 0 is solved
  bool other = false;          ///< it has another solution
  Vector y;
};
LaneStart start_of_lane(const LanePlan&, const Vector& x0, const Vector& g);

}  // namespace bromwich

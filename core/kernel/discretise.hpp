#pragma once

#include "discrete_problem.hpp"

namespace bromwich {

/// Samples the sources. `every_step`: tests inside every step whether they are linear there. `family`: what grids of
/// this scene share; null: nothing.
DiscreteProblem discretise(const Scene&, Backend&, Index J, bool every_step = false, GridFamily* family = nullptr);

/// Time points, f and g there and x0, without steps: for rows of solutions that are found otherwise.
DiscreteProblem discretise_points(const Scene&, Backend&, Index J);

/// The maps of its steps alone: without time points, f and g.
DiscreteProblem discretise_maps(const Scene&, Backend&, Index J, GridFamily&);

/// Samples f and g of the scene at the time points, and copies its x0.
void sample_points(DiscreteProblem&);
/// Samples the sources of the scene again, and copies its x0.
void sample_sources(DiscreteProblem&, bool every_step);
/// Copies only x0.
void set_start(DiscreteProblem&);

/// Finds the rough steps of the sampled sources and computes their contributions.
void resolve_sources(DiscreteProblem&, bool every_step);

/// The problem for implicit Euler, which uses the mean of f over each rough step.
DiscreteProblem with_mean_sources(const DiscreteProblem&);

/// The problem on a coarser grid with `steps` steps: every R-th row of the tables.
DiscreteProblem coarser(const DiscreteProblem&, Index steps);

}  // namespace bromwich

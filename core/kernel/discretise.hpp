#pragma once

#include "discrete_problem.hpp"

namespace bromwich {

/// Samples the sources. `every_step`: looks inside every step whether they are linear there.
DiscreteProblem discretise(const Scene&, Backend&, Index J, bool every_step = false);

/// Samples the sources of the scene again, and takes its x0.
void sample_sources(DiscreteProblem&, bool every_step);
/// Takes x0 alone.
void set_start(DiscreteProblem&);

/// Finds the rough steps of a problem whose sources are sampled, and what they do.
void resolve_sources(DiscreteProblem&, bool every_step);

/// The problem of implicit Euler, which takes f by its mean over each rough step.
DiscreteProblem with_mean_sources(const DiscreteProblem&);

/// The problem on a grid with `steps` steps, whose points are points of the given one: every R-th row of the tables.
DiscreteProblem coarser(const DiscreteProblem&, Index steps);

}  // namespace bromwich

#pragma once

#include "../accuracy/convergence.hpp"
#include "../result/inner_options.hpp"
#include "../seam/backend.hpp"

namespace bromwich {

/// A small scene by located events (core/events): two integrations, the second a thousand times as accurate, and a
/// third where the difference of the two says that the error of the second cannot be neglected.
///
/// With a tolerance the rows of the result are those of a grid of at least the scene's default steps, halved until y
/// and x are linear between them to the tolerance, where they are continuous. With `tolerance` 0 the grid is that of
/// the options. Each integration is given `most_work` floating-point operations, about.
///
/// Status solved; unsupported for another kind of scene; interrupted; or tolerance_not_met where an integration ended
/// early or the integrations differ by more than the tolerance, with the rows up to there. Scene::breakpoints have to
/// be all jumps and kinks of the sources.
Result solve_by_events(const Scene&, Backend&, const InnerOptions&, const ComponentSizes&, double tolerance,
                       double most_work);

}  // namespace bromwich

#pragma once

#include "../base/types.hpp"
#include "bromwich/options.hpp"
#include "log.hpp"
#include "method.hpp"

#include <vector>

namespace bromwich {

/// Whether any of the tolerances is set, so that error control chooses the steps.
bool controls_error(const Options&);

struct Scene;

/// What a solve reaches that names neither steps nor a tolerance; 0: it takes the steps of the scene.
double default_tolerance(const Scene&);

/// The options, with that tolerance where they name neither. Without one where they do not go with any: method goal,
/// event_location, confirm = false.
Options with_defaults(Options, const Scene&);

/// Time steps J of one grid, with a tolerance of the first one.
Index steps_of(const Scene&, const Options&);

/// The components of the state that Options::states selects.
std::vector<Index> recorded_components(const Scene&, const Options&);

}  // namespace bromwich

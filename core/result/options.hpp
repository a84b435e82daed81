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

/// The components of the state that Options::states selects.
std::vector<Index> recorded_components(const Scene&, const Options&);

}  // namespace bromwich

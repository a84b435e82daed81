#pragma once

#include "stage.hpp"

namespace bromwich {

/// The result of the first stage that does not pass. Precondition: a valid scene.
Result run_stages(const Scene&, Backend&, const InnerOptions&, const Solve&);

/// `solve` for a scene that is valid already.
Result solve_valid(const Scene&, Backend&, const InnerOptions&);

}  // namespace bromwich

#pragma once

#include "stage.hpp"

#include <string>

namespace bromwich {

/// The result of the first stage that does not pass. Precondition: a valid scene.
Result run_stages(const Scene&, Backend&, const InnerOptions&, const Solve&);

/// `solve` for a scene that is valid already.
Result solve_valid(const Scene&, Backend&, const InnerOptions&);

/// The result of a scene that was not solved: rows of NaN.
Result unsolved(const Scene&, const Backend&, const Options&, Status, const std::string& why);

}  // namespace bromwich

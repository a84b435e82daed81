#pragma once

#include "solve.hpp"

namespace bromwich {

Result solve_for_goal(const Scene&, Backend&, const Options&);

}  // namespace bromwich

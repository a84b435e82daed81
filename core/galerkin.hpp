#pragma once

#include "solve.hpp"

namespace bromwich {

Result solve_by_galerkin(const Scene&, Backend&, const Options&);

}  // namespace bromwich

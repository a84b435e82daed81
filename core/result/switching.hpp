#pragma once

#include "result.hpp"

#include <vector>

namespace bromwich {

/// For each switch the distance to the nearest one of its component and direction in `other`; `none` if there is none.
std::vector<double> distances(const std::vector<Switch>& found, const std::vector<Switch>& other, double none);

}  // namespace bromwich

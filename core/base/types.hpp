#pragma once

#include "bromwich/types.hpp"

namespace bromwich {

/// Machine epsilon of double, 2^-52.
inline constexpr double epsilon = 2.220446049250313e-16;

}  // namespace bromwich

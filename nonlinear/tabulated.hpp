#pragma once
// Sources that are evaluated again and again on one time grid: their values there are kept.

#include "../core/base/time_function.hpp"

namespace bromwich {

/// The same function, from a table of its `width` values at t_j = T j / J, and evaluated elsewhere, also on the sides
/// of a jump at t_j. At the t_j several threads may call it at once. Empty stays empty.
TimeFunction tabulated(const TimeFunction&, double T, Index J, Index width);

}  // namespace bromwich

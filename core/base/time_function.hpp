#pragma once

#include "bromwich/time_function.hpp"
#include "types.hpp"

#include <vector>

namespace bromwich {

/// by * function(t).
struct SourceTerm {
  Matrix by;
  TimeFunction function;  ///< as many values as `by` has columns; empty: 0
};

/// The sum of terms with as many rows, a separable source; empty if all are 0. It is known to be linear where all are.
TimeFunction sum_of(const std::vector<SourceTerm>&);

/// 1.
TimeFunction one_at_all_times();

}  // namespace bromwich

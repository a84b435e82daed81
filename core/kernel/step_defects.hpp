#pragma once

#include "../base/types.hpp"

#include <vector>

namespace bromwich {

/// Contributions of single steps to x_j beyond the rule for sources and y that are linear between grid points.
struct StepDefects {
  std::vector<Index> steps;  ///< increasing
  RowMatrix values;          ///< one row in R^m per step

  /// Adds them to the rows of `x`, one per time point, before the steps are summed up.
  void add_to(RowMatrix& x) const {
    for (std::size_t i = 0; i < steps.size(); ++i) x.row(steps[i]) += values.row(Index(i));
  }
};

}  // namespace bromwich

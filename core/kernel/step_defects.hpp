#pragma once

#include "../base/types.hpp"

#include <vector>

namespace bromwich {

/// What single steps add to x_j beyond the rule with sources and y that are linear between points of the grid.
struct StepDefects {
  std::vector<Index> steps;  ///< increasing
  RowMatrix values;          ///< a row in R^m for each

  /// Rows of `x`, one a time point, before the steps are summed up.
  void add_to(RowMatrix& x) const;
};

}  // namespace bromwich

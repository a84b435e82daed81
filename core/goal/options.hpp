#pragma once

#include "bromwich/goal.hpp"
#include "quantities.hpp"

#include <string>

namespace bromwich {

/// Evaluation of the solution on one grid.
struct GoalEvaluation {
  RowMatrix x;  ///< (M+1) x m
  double quantity = 0;
  Vector indicators;  ///< M, with signs: contribution of cell i to I(x_h) - I(x)
  Index sizes = 0;
  std::string elsewhere;  ///< work done on another machine than the backend's (StepChain::elsewhere)
  double rounding = 0;    ///< rounding error of the quantity
  bool blind = false;     ///< the input nearly vanishes at all points that the steps use, and not in between
};

}  // namespace bromwich

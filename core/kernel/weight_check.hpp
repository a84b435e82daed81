#pragma once

#include "discrete_problem.hpp"
#include "recurrence.hpp"

#include <string>

namespace bromwich {

struct WeightCheck {
  double error = 0;     ///< largest deviation of W_0, W_1, W_2, S_1 relative to the largest weight; NaN: not checked
  std::string against;  ///< "a circle of 64 nodes around the spectrum", "contours of 25 nodes", "" where not checked
};

/// Independent check of the matrix exponential of a dense scene: the first weights from shifted solves, on a circle
/// around the spectrum if h rho <= 9, otherwise on the contour of its sector. Not checked if there is neither, or if
/// the solves would cost more than `operations`.
WeightCheck check_weights(const DiscreteProblem&, const DenseRecurrence&, double operations);

}  // namespace bromwich

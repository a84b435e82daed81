#pragma once
// A march over a tree under a tolerance: the local tolerance is reduced until the solution and the one with twice the
// step on the same tree agree.

#include "../accuracy/convergence.hpp"
#include "tree_march.hpp"

namespace bromwich {

struct TreeGoal {
  double y = 0, x = 0;      ///< tolerances, one of them positive; 0: not controlled
  ComponentSizes sizes;     ///< of y and of all states
  bool y_may_jump = false;  ///< at a switch, which need not be at the same time in both solutions
  bool impulse = false;     ///< the state jumps at t = 0: y is known by its mean
  double rounding_of_y = 0, rounding_of_mean = 0, rounding_of_x = 0;  ///< relative, that of one step
};

struct TreeSolution {
  TreeRows rows;
  Distance error;            ///< to twice the step
  bool of_integral = false;  ///< the mean of y is known, y itself is not: a row and a jump of y are close to each other
  Index steps = 0;

  double error_of_y() const { return of_integral ? error.mean : error.y; }
};

/// The rows, in the form of a result.
Result as_result(const Vector& times, TreeRows);

/// Nothing where the tolerance is not met.
std::optional<TreeSolution> march_to_goal(TreeMarch&, const TreeGoal&);

}  // namespace bromwich

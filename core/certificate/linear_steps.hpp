#pragma once
// y of a result as its method means it: linear on each step.

#include "../result/result.hpp"

namespace bromwich {

class LinearSteps {
 public:
  /// The result has to outlive the object.
  explicit LinearSteps(const Result&);

  Vector at(Index step, double place) const {
    return ((1 - place) * left_.row(step - 1) + place * right_.row(step)).transpose();
  }
  /// The ends of steps first, first + 1, ...: a row each.
  auto begins(Index first, Index steps) const { return left_.middleRows(first - 1, steps); }
  auto ends(Index first, Index steps) const { return right_.middleRows(first, steps); }
  const RowMatrix& integral() const { return integral_; }  ///< (J+1) x n, over [0, t_j]

 private:
  const RowMatrix& right_;
  RowMatrix integral_, left_;
};

}  // namespace bromwich

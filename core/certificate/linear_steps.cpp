#include "core/certificate/linear_steps.hpp"

namespace bromwich {

// From the value at the right end and the mean of each step.
LinearSteps::LinearSteps(const Result& r) : right_(r.y), integral_(integral_of_y(r)) {
  const Index J = r.y.rows() - 1;
  left_ = r.y.topRows(J);
  if (r.continuous && !by_euler(r) && r.y.row(0).allFinite()) return;
  for (Index j = 1; j <= J; ++j)
    left_.row(j - 1) = 2 * (integral_.row(j) - integral_.row(j - 1)) / (r.t[j] - r.t[j - 1]) - r.y.row(j);
}

}  // namespace bromwich

#include "core/numerics/alternation.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

void largest_of_columns(const RowMatrix& y, Index begin, Index end, Vector& largest) {
  double* const to = largest.data();
  for (Index j = begin; j < end; ++j) {
    const double* const row = y.row(j).data();
    for (Index i = 0; i < y.cols(); ++i) {
      const double size = std::abs(row[i]);
      to[i] = size > to[i] ? size : to[i];
    }
  }
}

// Row by row, as y lies in memory; `length` is that of the run so far.
bool alternates(const RowMatrix& y, Index begin, Index end, const Vector& least, Index run) {
  const Index n = y.cols();
  Vector before = Vector::Zero(n);
  Eigen::Matrix<Index, Eigen::Dynamic, 1> lengths = Eigen::Matrix<Index, Eigen::Dynamic, 1>::Zero(n);
  double* const last = before.data();
  Index* const length = lengths.data();
  for (Index j = std::max<Index>(1, begin - run); j < std::min(end, y.rows() - 1); ++j) {
    const double *above = y.row(j - 1).data(), *here = y.row(j).data(), *below = y.row(j + 1).data();
    Index longest = 0;
    for (Index i = 0; i < n; ++i) {
      const double bend = above[i] - 2 * here[i] + below[i];
      const Index longer = length[i] + 1;
      const bool goes_on = (std::abs(bend) > least[i]) & (bend * last[i] < 0);
      length[i] = goes_on ? longer : 0;
      last[i] = bend;
      longest = std::max(longest, length[i]);
    }
    if (longest >= run) return true;
  }
  return false;
}

}  // namespace bromwich

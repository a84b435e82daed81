#include "core/derivatives/set_margin.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"

#include <algorithm>

namespace bromwich {

namespace {

constexpr double degenerate = 1e-10;  ///< of the largest y_i and w_i: margins below count as y_i = w_i = 0

}  // namespace

DerivativeMargin margin_of_sets(const RowMatrix& y, const RowMatrix& w, const Vector& t, const ActiveSetAt& active_at) {
  DerivativeMargin found;
  for (Index i = 0; i < y.cols(); ++i) {
    const double most_y = y.col(i).cwiseAbs().maxCoeff(), most_w = w.col(i).cwiseAbs().maxCoeff();
    for (Index j = 0; j < y.rows(); ++j) {
      const std::vector<Index>& S = active_at(j);
      const bool active = std::binary_search(S.begin(), S.end(), i);
      if (active && y(j, i) <= 0) continue;  // a free row
      const double most = active ? most_y : most_w, value = active ? y(j, i) : w(j, i);
      const double margin = most > 0 ? std::max(0.0, value) / most : 0;
      if (j == 0 && !active && margin <= degenerate) continue;  // see undecided_at_start
      if (margin < found.margin) found = {margin, t[j], i};
    }
  }
  if (found.margin <= degenerate)
    throw Error("derivative",
                text("not differentiable here: y_%ld = w_%ld = 0 at t = %.6g, where derivatives are one-sided",
                     long(found.constraint), long(found.constraint), found.time),
                "change the data or the number of steps slightly");
  return found;
}

std::vector<Index> undecided_at_start(const RowMatrix& y, const RowMatrix& w, const std::vector<Index>& active) {
  std::vector<Index> found;
  for (Index i = 0; i < y.cols(); ++i)
    if (!std::binary_search(active.begin(), active.end(), i) && w(0, i) <= degenerate * w.col(i).cwiseAbs().maxCoeff())
      found.push_back(i);
  return found;
}

}  // namespace bromwich

#pragma once
// How far active sets are from changing, and the constraints at t = 0 that are not decided.

#include "solution_derivative.hpp"

#include <functional>
#include <vector>

namespace bromwich {

/// S_j, increasing.
using ActiveSetAt = std::function<const std::vector<Index>&(Index j)>;

/// The smallest max(y_i, w_i) at a time point, relative to the largest y_i and w_i of the component. Components at t =
/// 0 with y_i = w_i = 0 are left out (undecided_at_start). Throws Error where it is 0 to rounding.
DerivativeMargin margin_of_sets(const RowMatrix& y, const RowMatrix& w, const Vector& t, const ActiveSetAt&);

/// Constraints with y_i = w_i = 0 at t = 0, as where everything starts from rest. Changes that leave w_i there have a
/// derivative all the same.
std::vector<Index> undecided_at_start(const RowMatrix& y, const RowMatrix& w, const std::vector<Index>& active);

}  // namespace bromwich

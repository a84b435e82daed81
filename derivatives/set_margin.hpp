#pragma once
// How far active sets are from changing, and the constraints at t = 0 that are not decided.

#include "../core/lcp/matrix.hpp"
#include "bromwich/derivative.hpp"

#include <functional>
#include <vector>

namespace bromwich {

/// S_j, increasing.
using ActiveSetAt = std::function<const std::vector<Index>&(Index j)>;

/// Values of y_i and w_i that rounding explains, n each: they count as 0.
struct SetRounding {
  Vector y, w;
};

/// Of w = N x + M y + g. `terms` (n): the largest absolute values over time that add up to N x.
SetRounding rounding_of_sets(const Vector& terms, const LcpMatrix& M, const RowMatrix& y, const RowMatrix& g);

/// The smallest max(y_i, w_i) at a time point, relative to the largest y_i and w_i of the component. Components at t =
/// 0 with y_i = w_i = 0 are left out (undecided_at_start). Throws Error where it is 0 to rounding.
DerivativeMargin margin_of_sets(const RowMatrix& y, const RowMatrix& w, const SetRounding&, const Vector& t,
                                const ActiveSetAt&);

/// Constraints with y_i = w_i = 0 at t = 0, as where everything starts from rest. Changes that leave w_i there have a
/// derivative all the same.
std::vector<Index> undecided_at_start(const RowMatrix& w, const SetRounding&, const std::vector<Index>& active);

/// Throws Error where a change of the data moves w_i at t = 0 for one of these constraints i. `terms`: the absolute
/// values that add up to the change of w(0); rounding of them counts as no change.
void check_change_at_start(const std::vector<Index>& undecided, const Vector& change_of_w, const Vector& terms);

/// Whether a gradient has y(0) + w(0) of one of these constraints in it, by its weight. What moves w_i there has a
/// derivative from one side only.
bool weighs_start(const std::vector<Index>& undecided, const Vector& weight, double terms);

}  // namespace bromwich

#pragma once
// Fewer points for a picture, without losing an extreme value: a spike of one row stays visible.

#include "core/base/types.hpp"

#include <vector>

namespace bromwich::report {

/// The rows of a curve to draw, ascending. [t_first, t_last] is divided into `buckets` equal parts; of the rows in each
/// part the first, the last, the smallest and the largest value are kept, and of rows without a value (NaN) the first
/// and the last of a run. All rows if there are no more than 4 * buckets. `t` ascends.
std::vector<Index> thinned(const Eigen::Ref<const Vector>& t, const Eigen::Ref<const Vector>& values, Index buckets);

/// The same of a curve in the plane: the rows are taken in their order, and extreme values of x and of y are kept.
std::vector<Index> thinned_orbit(const Eigen::Ref<const Vector>& x, const Eigen::Ref<const Vector>& y, Index buckets);

/// values (rows x columns) on `columns` equal parts of [t_first, t_last] and `bands` parts of the columns: bands x
/// columns. A cell has the value of largest modulus of its block. Where rows are farther apart than a cell it has the
/// value of the row before. NaN where there is no value.
RowMatrix on_cells(const Eigen::Ref<const Vector>& t, const RowMatrix& values, Index columns, Index bands);

}  // namespace bromwich::report

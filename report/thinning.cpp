#include "report/thinning.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

namespace bromwich::report {

namespace {

/// The part of [t_first, t_last] that contains t_j.
Index part_of(const Eigen::Ref<const Vector>& t, Index j, Index parts) {
  const double length = t[t.size() - 1] - t[0];
  if (!(length > 0)) return 0;
  return std::clamp<Index>(Index((t[j] - t[0]) / length * double(parts)), 0, parts - 1);
}

/// The rows to keep of one part.
struct Kept {
  Index first = -1, last = -1, smallest = -1, largest = -1;

  void add(Index j, double value, const Eigen::Ref<const Vector>& values) {
    if (first < 0) first = j;
    last = j;
    if (std::isnan(value)) return;
    if (smallest < 0 || value < values[smallest]) smallest = j;
    if (largest < 0 || value > values[largest]) largest = j;
  }

  void append(std::vector<Index>& rows) const {
    for (const Index j : {first, smallest, largest, last})
      if (j >= 0) rows.push_back(j);
  }
};

}  // namespace

std::vector<Index> thinned(const Eigen::Ref<const Vector>& t, const Eigen::Ref<const Vector>& values, Index buckets) {
  std::vector<Index> rows;
  const Index count = t.size();
  if (count <= 4 * buckets) {
    for (Index j = 0; j < count; ++j) rows.push_back(j);
    return rows;
  }
  std::vector<Kept> parts(static_cast<std::size_t>(buckets));
  for (Index j = 0; j < count; ++j) {
    parts[std::size_t(part_of(t, j, buckets))].add(j, values[j], values);
    const bool gap = std::isnan(values[j]);
    const bool edge = j == 0 || j + 1 == count || std::isnan(values[j - 1]) != gap || std::isnan(values[j + 1]) != gap;
    if (edge) rows.push_back(j);
  }
  for (const Kept& part : parts) part.append(rows);
  std::sort(rows.begin(), rows.end());
  rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
  return rows;
}

std::vector<Index> thinned_orbit(const Eigen::Ref<const Vector>& x, const Eigen::Ref<const Vector>& y, Index buckets) {
  const Vector place = Vector::LinSpaced(x.size(), 0, double(x.size() - 1));
  const std::vector<Index> of_x = thinned(place, x, buckets), of_y = thinned(place, y, buckets);
  std::vector<Index> rows;
  std::set_union(of_x.begin(), of_x.end(), of_y.begin(), of_y.end(), std::back_inserter(rows));
  return rows;
}

RowMatrix on_cells(const Eigen::Ref<const Vector>& t, const RowMatrix& values, Index columns, Index bands) {
  const Index n = values.cols();
  bands = std::min(bands, n);
  RowMatrix cells = RowMatrix::Constant(bands, columns, std::numeric_limits<double>::quiet_NaN());
  const auto take = [&](double value, double& cell) {
    if (std::isnan(cell) || std::abs(value) > std::abs(cell)) cell = value;
  };
  Index before = -1;  // the last column with a row
  for (Index j = 0; j < t.size(); ++j) {
    const Index column = part_of(t, j, columns);
    if (j > 0 && before >= 0)
      for (Index skipped = before + 1; skipped < column; ++skipped)
        for (Index i = 0; i < n; ++i) take(values(j - 1, i), cells(i * bands / n, skipped));
    for (Index i = 0; i < n; ++i) take(values(j, i), cells(i * bands / n, column));
    before = column;
  }
  return cells;
}

}  // namespace bromwich::report

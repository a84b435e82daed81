#include "core/scan/source_numbers.hpp"

#include <cmath>
#include <optional>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

// b = scale a + shift up to rounding.
std::optional<std::pair<double, double>> as_multiple(const RowMatrix& table, Index a, Index b, Index low, Index high) {
  const double scale = (table(high, b) - table(low, b)) / (table(high, a) - table(low, a));
  const double shift = table(low, b) - scale * table(low, a);
  for (Index j = 1; j < table.rows(); ++j) {
    const double value = table(j, b), part = scale * table(j, a);
    if (!(std::abs(value - part - shift) <= 4 * epsilon * (std::abs(value) + std::abs(part) + std::abs(shift))))
      return std::nullopt;
  }
  return std::pair(scale, shift);
}

struct Extremes {
  Index low = 1, high = 1;
};

Extremes extremes_of(const RowMatrix& table, Index column) {
  Extremes range;
  for (Index j = 1; j < table.rows(); ++j) {
    if (table(j, column) < table(range.low, column)) range.low = j;
    if (table(j, column) > table(range.high, column)) range.high = j;
  }
  return range;
}

}  // namespace

SourceNumbers source_numbers(const RowMatrix& table) {
  SourceNumbers found{{}, Vector::Zero(table.cols()), Matrix::Zero(table.cols(), table.cols())};
  std::vector<Index> kept;
  std::vector<Extremes> ranges;
  for (Index k = 0; k < table.cols(); ++k) {
    const Extremes range = extremes_of(table, k);
    if (table(range.low, k) == table(range.high, k)) {
      found.constant[k] = table(range.low, k);
      continue;
    }
    bool known = false;
    for (std::size_t a = 0; a < kept.size() && !known; ++a)
      if (const auto multiple = as_multiple(table, kept[a], k, ranges[a].low, ranges[a].high)) {
        found.of(k, Index(a)) = multiple->first;
        found.constant[k] = multiple->second;
        known = true;
      }
    if (known) continue;
    found.of(k, Index(kept.size())) = 1;
    kept.push_back(k);
    ranges.push_back(range);
  }
  found.of = found.of.leftCols(Index(kept.size())).eval();
  found.numbers = table(Eigen::all, kept);
  return found;
}

}  // namespace bromwich

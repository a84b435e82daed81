#include "core/accuracy/impact_sides.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr std::ptrdiff_t most_moved = 4;  ///< impacts to one side of a row

Vector sizes(const RowMatrix& rows) {
  constexpr double smallest = 1e-3;  // of the largest component
  Vector size = rows.cwiseAbs().colwise().maxCoeff().transpose();
  const double largest = size.size() > 0 ? size.maxCoeff() : 0;
  return size.cwiseMax(std::max(smallest * largest, 1e-290));
}

}  // namespace

void take_sides(const std::vector<Impact>& impacts, const Vector& t, const std::vector<Index>& recorded,
                const std::function<RowOfSolution(Index)>& other, RowMatrix& x, RowMatrix& integral) {
  const Vector of_x = sizes(x), of_integral = sizes(integral);
  const double h = t[1] - t[0];
  const auto at = [&](double time) {
    return std::partition_point(impacts.begin(), impacts.end(), [&](const Impact& i) { return i.t <= time; });
  };
  for (Index j = 1; j < t.size(); ++j) {
    const auto first = at(t[j] - h), here = at(t[j]), last = at(t[j] + h);
    if (first == last || !x.row(j).allFinite()) continue;
    const RowOfSolution beside = other(j);
    const auto apart = [&](const RowOfSolution& row) {
      return (row.x - beside.x).cwiseAbs().cwiseQuotient(of_x).sum() +
             (row.integral - beside.integral).cwiseAbs().cwiseQuotient(of_integral).sum();
    };
    const RowOfSolution own{x.row(j).transpose(), integral.row(j).transpose()};
    RowOfSolution nearest = own, moved = own;
    const auto move = [&](const Impact& impact, double sign) {
      moved.x += sign * impact.jump(recorded);
      moved.integral += sign * impact.p;
      if (apart(moved) < apart(nearest)) nearest = moved;
    };
    for (auto i = here; i != first && here - i < most_moved; --i) move(*std::prev(i), -1);
    moved = own;
    for (auto i = here; i != last && i - here < most_moved; ++i) move(*i, 1);
    x.row(j) = nearest.x.transpose();
    integral.row(j) = nearest.integral.transpose();
  }
}

}  // namespace bromwich

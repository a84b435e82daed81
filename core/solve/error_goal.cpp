#include "core/solve/error_goal.hpp"

#include "core/scene/natural_units.hpp"

#include <algorithm>
#include <numeric>

namespace bromwich {

namespace {

constexpr double rounding_of_terms = 64 * epsilon;  ///< of size 1, as sums of them accumulate it

}  // namespace

ErrorGoal::ErrorGoal(const Options& o)
    : y(o.tolerance_y > 0 ? o.tolerance_y : o.tolerance), x(o.tolerance_x > 0 ? o.tolerance_x : o.tolerance) {
  if (o.tolerance_y == 0 && o.tolerance_x == 0 && o.tolerance == 0) y = x = o.absolute_tolerance;
  if (!o.control_states) x = 0;
}

double ErrorGoal::smallest() const { return y > 0 && x > 0 ? std::min(y, x) : std::max(y, x); }

ComponentSizes sizes_for(const Scene& scene, const InnerOptions& o) {
  ComponentSizes sizes;
  const bool none = o.tolerance == 0 && o.tolerance_x == 0 && o.tolerance_y == 0;
  sizes.relative = !none || o.absolute_tolerance == 0;
  if (sizes.relative) {
    const double tolerance = none ? assumed_tolerance : ErrorGoal(o).smallest();
    sizes.absolute = o.absolute_tolerance / tolerance;
    sizes.zero = rounding_of_terms / tolerance;
  }
  if (!o.units || o.units->trivial()) return sizes;
  const auto ones = [](const std::vector<int>& exponents, const std::vector<Index>& which) {
    Vector one(Index(which.size()));
    for (std::size_t i = 0; i < which.size(); ++i) one[Index(i)] = times_ten_to(-exponents[std::size_t(which[i])], 1);
    return one;
  };
  std::vector<Index> rows(o.units->y.size());
  std::iota(rows.begin(), rows.end(), Index(0));
  sizes.one_y = ones(o.units->y, rows);
  sizes.one_x = ones(o.units->x, recorded_components(scene, o));
  return sizes;
}

}  // namespace bromwich

#include "core/solve/located_values.hpp"

#include "core/lcp/lcp_class.hpp"
#include "core/scene/breakpoints.hpp"
#include "core/solve/scaling.hpp"

namespace bromwich {

namespace {

// Of the last coefficients of steps. What counts as zero falls with it: signs may be known with the second.
constexpr double tolerances[] = {1e-10, 1e-11};
constexpr double steps_in_T = 48;

Vector in_units_of_scene(Vector v, const std::vector<int>& units) {
  for (std::size_t i = 0; i < units.size(); ++i) v[Index(i)] = times_ten_to(units[i], v[Index(i)]);
  return v;
}

}  // namespace

std::optional<LocatedValues> LocatedValues::find(const Scene& given) {
  LocatedValues values;
  // Method events has written out small sparse dynamics, too.
  const bool sparse = given.dynamics->matrices() && !given.dynamics->small_state();
  Scene scene = sparse ? written_out(given) : given;
  if (!unsuited_to_events(scene).empty()) return std::nullopt;
  values.units_ = natural_units(scene);
  scene = in_natural_units(scene, values.units_);
  const std::vector<double> breakpoints =
      scene.breakpoints_are_all || (!scene.f && !scene.g) ? scene.breakpoints : find_breakpoints(scene);
  EventOptions options;
  options.longest_step = scene.T / steps_in_T;
  for (const double tolerance : tolerances) {
    options.tolerance = tolerance;
    values.solution_ = integrate_with_events(scene, selection_class(scene.M, scene.lcp_class), breakpoints, options);
    if (values.solution_.complete) return values;
  }
  return std::nullopt;
}

Vector LocatedValues::x(double t) const { return in_units_of_scene(solution_.x(t, true), units_.x); }

Vector LocatedValues::y(double t) const { return in_units_of_scene(solution_.y(t, true).cwiseMax(0), units_.y); }

}  // namespace bromwich

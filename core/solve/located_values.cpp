#include "core/solve/located_values.hpp"

#include "core/events/collocation.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/scene/breakpoints.hpp"
#include "core/solve/scaling.hpp"

#include <algorithm>
#include <limits>

namespace bromwich {

namespace {

// Of the last coefficients of steps. What counts as zero falls with it: signs may be known with the second.
constexpr double tolerances[] = {1e-10, 1e-11};
constexpr double steps_in_T = 48;

/// n: the largest y of active constraints on a piece; 0 for others.
Vector largest_y(const EventPiece& piece) {
  constexpr int parts = 8;
  Vector largest = Vector::Zero(piece.y.cols());
  for (int k = 0; k <= parts; ++k) {
    const Vector y = piece.y.transpose() * legendre((piece.end - piece.begin) / piece.length * k / parts);
    for (const Index i : piece.active) largest[i] = std::max(largest[i], y[i]);
  }
  return largest;
}

/// Of the piece and the one before.
double longest_of(const std::vector<EventPiece>& pieces, std::size_t k) {
  const auto length = [](const EventPiece& piece) { return piece.end - piece.begin; };
  return std::max(length(pieces[k]), k > 0 ? length(pieces[k - 1]) : 0);
}

Vector in_units_of_scene(Vector v, const std::vector<int>& units) {
  for (std::size_t i = 0; i < units.size(); ++i) v[Index(i)] = times_ten_to(units[i], v[Index(i)]);
  return v;
}

}  // namespace

std::optional<LocatedValues> LocatedValues::find(const Scene& given, double tolerance) {
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
  options.tolerance = tolerance;
  values.solution_ = integrate_with_events(scene, selection_class(scene.M, scene.lcp_class), breakpoints, options);
  if (!values.solution_.complete) return std::nullopt;
  return values;
}

std::optional<LocatedValues> LocatedValues::find(const Scene& scene) {
  for (const double tolerance : tolerances)
    if (std::optional<LocatedValues> values = find(scene, tolerance)) return values;
  return std::nullopt;
}

Vector LocatedValues::x(double t) const { return in_units_of_scene(solution_.x(t, true), units_.x); }

Vector LocatedValues::y(double t) const { return in_units_of_scene(solution_.y(t, true).cwiseMax(0), units_.y); }

std::vector<Switch> LocatedValues::switches(double negligible) const {
  const std::vector<EventPiece>& pieces = solution_.pieces;
  const Index n = pieces.front().y.cols();
  RowMatrix largest(Index(pieces.size()), n);
  for (std::size_t k = 0; k < pieces.size(); ++k) largest.row(Index(k)) = largest_y(pieces[k]).transpose();
  const Vector zero = negligible * largest.colwise().maxCoeff().transpose();
  const double rounding = 4 * std::numeric_limits<double>::epsilon() * pieces.back().end;
  const Vector start = solution_.y(0, false);
  std::vector<Switch> found;
  for (std::size_t k = 0; k < pieces.size(); ++k)
    for (Index i = 0; i < n; ++i) {
      const bool before = (k == 0 ? start[i] : largest(Index(k) - 1, i)) > zero[i], on = largest(Index(k), i) > zero[i];
      if (before == on) continue;
      const bool passed = pieces[k].passed || (k > 0 && pieces[k - 1].passed);
      found.push_back({pieces[k].begin, i, on, passed ? longest_of(pieces, k) : rounding});
    }
  return found;
}

}  // namespace bromwich

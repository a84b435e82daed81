// Sliding: where it ends or turns within a part, and the rows of friction on circles.

#include "core/march/impact_steps.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

// Numbered as these rows are.
std::vector<ImpactCone> ImpactSteps::cones_among(const std::vector<Index>& rows) const {
  std::vector<ImpactCone> cones;
  for (const FrictionCone& cone : rows_.cones) {
    const auto tangent = std::lower_bound(rows.begin(), rows.end(), cone.first + 1);
    if (tangent != rows.end() && *tangent == cone.first + 1)
      cones.push_back({Index(tangent - rows.begin()) - 1, cone.mu, cone.given});
  }
  return cones;
}

// Directions in which contacts slide on circles, 2 x cones; 0: they do not slide.
Matrix ImpactSteps::slides(const SmoothSources& now, double s, const std::vector<Index>& rows) const {
  const std::vector<ImpactCone> cones = cones_among(rows);
  Matrix along = Matrix::Zero(2, Index(cones.size()));
  if (cones.empty() || rests_) return along;
  const Look at = look(now, s, x_, y_);
  for (Index k = 0; k < along.cols(); ++k) {
    const Index i = rows[std::size_t(cones[std::size_t(k)].first + 1)];
    const Vector w = at.w.segment(i, 2);
    if (w.norm() > std::max(at.rest(i, h_), at.rest(i + 1, h_))) along.col(k) = w.normalized();
  }
  return along;
}

// Of bounds that are given the mean acts over a part, and at its end their value.
void ImpactSteps::show_given_bounds(const SmoothSources& now, double to, Part& part) const {
  for (const ImpactCone& cone : cones_among(part.rows)) {
    const Index first = part.rows[std::size_t(cone.first)];
    const double mean = part.shown[first], bound = -value(now.g, first, to);
    if (!cone.given || !(mean > 0)) continue;
    const bool slips = part.shown.segment(first + 1, 2).norm() >= (1 - at_bound) * cone.mu * mean;
    part.shown.segment(first, slips ? 3 : 1) *= bound / mean;
  }
}

bool ImpactSteps::goes_on(const Sliding& s, const Look& begin, const Look& there) const {
  const auto rest = [&](const Look& at) { return std::max(at.rest(s.first, h_), at.rest(s.second, h_)); };
  return s.of(there.w) > std::max(rest(begin), rest(there));
}

// Contacts that slide at the begin of a part and at its end not in that direction: planar ones by one row.
std::vector<ImpactSteps::Sliding> ImpactSteps::sliding(const Look& begin, const Look& end,
                                                       const std::vector<Index>& rows) const {
  std::vector<Sliding> found;
  const auto add = [&](Index first, Index second, const Eigen::Vector2d& along) {
    const Sliding s{first, second, along};
    if (!goes_on(s, begin, end)) found.push_back(s);
  };
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const Index i = rows[k];
    if (!rows_.is(i, Kind::speed)) continue;
    if (!rows_.in_cone[std::size_t(i)]) {
      if (std::abs(begin.w[i]) > begin.rest(i, h_)) add(i, i, {begin.w[i] > 0 ? 1.0 : -1.0, 0.0});
    } else if (const Eigen::Vector2d w = begin.w.segment(i, 2);
               w.norm() > std::max(begin.rest(i, h_), begin.rest(i + 1, h_))) {
      add(i, i + 1, w.normalized());
    }
    k += std::size_t(rows_.in_cone[std::size_t(i)]);  // its other row
  }
  return found;
}

// Whether sliding on a circle turns by so much on the part that the mean of both directions is far from the mean of
// all, as where it nearly stops.
bool ImpactSteps::turns_far(const SmoothSources& now, double from, double d, const Part& part) const {
  const std::vector<ImpactCone> cones = cones_among(part.rows);
  if (cones.empty() || rests_) return false;
  const Look begin = look(now, from, x_, y_), end = look(now, from + d, part.x, part.y);
  return std::any_of(cones.begin(), cones.end(), [&](const ImpactCone& cone) {
    const Index i = part.rows[std::size_t(cone.first + 1)];
    const Eigen::Vector2d u = begin.w.segment(i, 2), v = end.w.segment(i, 2);
    const double zero = std::max({begin.rest(i, h_), begin.rest(i + 1, h_), end.rest(i, h_), end.rest(i + 1, h_)});
    return std::min(u.norm(), v.norm()) > zero && u.dot(v) < most_turn * u.norm() * v.norm();
  });
}

// Sliding ends within the part where it has another direction at its end, or none. Constant forces of the whole part do
// not tell when, since friction jumps there. Those of a part that is so short that it goes on do. On a circle it ends
// where nothing is left in the direction of the begin, and what is left across goes on. 0: it has ended at the begin.
double ImpactSteps::first_turn(const SmoothSources& now, double from, double d, const Look& begin, const Look& end,
                               const Part& part) {
  const std::vector<Sliding> ends = sliding(begin, end, part.rows);
  if (ends.empty()) return INFINITY;
  Part brief;
  for (double length = d / shorter; length > brief_turn * h_; length /= shorter) {
    if (!take(now, from, length, brief)) return INFINITY;
    const Look there = look(now, from + length, brief.x, brief.y);
    if (!std::all_of(ends.begin(), ends.end(), [&](const Sliding& s) { return goes_on(s, begin, there); })) continue;
    Matrix x = x_;
    QuadraticColumns input = from_there(now.f, from);
    input[0] += rows_.B * brief.y;
    flow_.advance(d, input, x);
    const Look a = look(now, from, x_, brief.y), b = look(now, from + d, x, brief.y);
    double first = INFINITY;
    for (const Sliding& s : ends)
      first = std::min(first, first_fall({s.of(a.w), s.of(a.slope), s.of(b.w), s.of(b.slope)}, d, 0));
    return first > brief_turn * h_ ? first : 0;
  }
  return 0;
}

}  // namespace bromwich

#pragma once
// Kinds of contacts, and where their rows are.

#include "bromwich/mechanics.hpp"

#include <cmath>
#include <numbers>

namespace bromwich {

inline bool is_Jenkins(const Contact& c) { return c.kt > 0; }
inline bool has_friction(const Contact& c) { return c.tangent.rows() > 0 && (c.mu > 0 || c.bound); }

inline bool is_circle(const Contact& c) { return has_friction(c) && c.tangent.rows() == 2 && c.facets == 0; }
/// The force lt = b - R of planar friction.
inline bool shifts_by_bound(const Contact& c, const ContactRows& r) {
  return c.bound && r.state < 0 && c.facets == 0 && !is_circle(c);
}
/// Of a circle: the first row of lt.
inline Index circle_row(const ContactRows& r) { return r.normal >= 0 ? r.friction : r.friction + 1; }

// A unit vector for each facet, k x 2.
inline Matrix directions(Index facets) {
  Matrix d(facets, 2);
  for (Index k = 0; k < facets; ++k) {
    const double angle = 2 * std::numbers::pi * double(k) / double(facets);
    d.row(k) << std::cos(angle), std::sin(angle);
  }
  return d;
}

}  // namespace bromwich

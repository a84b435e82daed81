#pragma once
// The extreme values of a polynomial on a part of its step.

#include "../events/collocation.hpp"

#include <algorithm>

namespace bromwich {

struct Extremes {
  double least, largest;
};

/// On [0, until], of Legendre coefficients: the best of a few places, and from there a zero of the derivative.
inline Extremes extremes_of(const Vector& c, double until) {
  constexpr int places = 8, steps = 4;
  const Vector slope = Collocation::get().derivative * c, bend = Collocation::get().derivative * slope;
  const auto value = [&](double at) { return legendre(at).dot(c); };
  double low = 0, high = 0;
  for (int k = 1; k <= places; ++k) {
    const double at = until * k / places;
    if (value(at) < value(low)) low = at;
    if (value(at) > value(high)) high = at;
  }
  const auto refined = [&](double at) {
    for (int k = 0; k < steps; ++k) {
      const double b = legendre(at).dot(bend);
      if (b != 0) at = std::clamp(at - legendre(at).dot(slope) / b, 0.0, until);
    }
    return value(at);
  };
  return {std::min(value(low), refined(low)), std::max(value(high), refined(high))};
}

}  // namespace bromwich

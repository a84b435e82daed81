#pragma once
// Weyl's sequences: numbers that spread evenly over [0, 1) and are in step with no period. Sources are looked at there.

#include <cmath>

namespace bromwich {

/// The fraction of k times the golden ratio.
inline double irregular(double k) {
  const double at = 0.6180339887498949 * k;
  return at - std::floor(at);
}

/// The same with the square root of 2: with the other, points that spread evenly over a square.
inline double irregular_beside(double k) {
  const double at = 0.4142135623730951 * k;
  return at - std::floor(at);
}

}  // namespace bromwich

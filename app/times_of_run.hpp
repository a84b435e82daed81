#pragma once
// Times of a part of a run in parts, in those of the whole run.

#include "core/base/types.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace bromwich::app {

/// Times of a part that begins at row `begin` as times of the run of J steps to T. Its time points are those of the run
/// to the last digit: f and g may jump there. Times beside them stay beside them, where the difference is below
/// rounding of the time of the run, too.
struct TimesOfRun {
  double T;
  Index J, begin;
  double length;
  Index steps;

  double of(double s) const {
    const double k = std::round(s / length * double(steps)), off = s - k * length / double(steps);
    const double at = (double(begin) + k) * T / double(J);
    if (std::abs(off) <= 4 * epsilon * length) return at;
    return std::clamp(at + std::copysign(std::max(std::abs(off), 4 * epsilon * T), off), 0.0, T);
  }

  /// The breakpoints inside the part, as its times.
  std::vector<double> in_part(const std::vector<double>& breakpoints) const {
    std::vector<double> inside;
    const double h = length / double(steps);
    for (const double t : breakpoints) {
      const double k = std::round(t / T * double(J)), off = t - k * T / double(J);
      const double s = (k - double(begin)) * h + (std::abs(off) <= 4 * epsilon * T ? 0 : off);
      if (s > 0 && s < length && (inside.empty() || s > inside.back())) inside.push_back(s);
    }
    return inside;
  }
};

}  // namespace bromwich::app

#pragma once

#include <vector>

namespace bromwich {

/// Exponents: x_i = 10^{x[i]} x~_i and so on. Empty: all zero.
struct NaturalUnits {
  std::vector<int> x, y, w;
  std::vector<int> boundary;  ///< rows of E0, ET and b are divided by 10^boundary[i]

  bool trivial() const { return x.empty(); }
};

/// Of initial values: those of boundary rows do not count.
inline bool same_units(const NaturalUnits& a, const NaturalUnits& b) { return a.x == b.x && a.y == b.y && a.w == b.w; }

/// Exponents are between -140 and 140.
inline constexpr int largest_exponent = 140;

/// Value times 10^k, rounded once.
double times_ten_to(int k, double value);

}  // namespace bromwich

#include "core/scene/natural_units.hpp"

#include <array>
#include <cmath>
#include <cstddef>

namespace bromwich {

double times_ten_to(int k, double value) {
  if (k == 0) return value;
  static const auto powers = [] {
    std::array<double, 2 * largest_exponent + 1> p;
    for (std::size_t e = 0; e < p.size(); ++e) p[e] = std::pow(10.0, double(e));
    return p;
  }();
  return k > 0 ? value * powers[std::size_t(k)] : value / powers[std::size_t(-k)];
}

}  // namespace bromwich

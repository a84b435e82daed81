#include "core/dynamics/second_difference.hpp"

#include <cmath>
#include <numbers>

namespace bromwich {

Vector SecondDifference::eigenvalues() const {
  const double scale = -4 * diffusivity / (spacing * spacing);
  Vector lambda(points);
  for (Index k = 1; k <= points; ++k) {
    const double s = std::sin(double(k) * std::numbers::pi / (2 * double(points + 1)));
    lambda[k - 1] = scale * s * s;
  }
  return lambda;
}

}  // namespace bromwich

#include "core/dynamics/spectrum.hpp"

#include "core/base/text.hpp"

namespace bromwich {

std::string Spectrum::describe() const {
  constexpr double degree = 57.29577951308232;
  if (bound) return text("bound given: half-angle %.1f degrees, abscissa %.3g", half_angle * degree, abscissa);
  if (radius == 0) return "zero";
  const bool unstable = abscissa > 16 * epsilon * radius, imaginary = !unstable && half_angle * degree > 89.9999;
  const std::string kind = unstable          ? text("unstable, abscissa %.3g", abscissa)
                           : real_negative() ? "real"
                           : imaginary       ? "imaginary"
                                             : text("sector of half-angle %.1f degrees", half_angle * degree);
  const std::string moduli = slowest > 0 && slowest < radius ? text(", moduli %.3g to %.3g", slowest, radius)
                             : slowest > 0                   ? text(", modulus %.3g", radius)
                                                             : text(", moduli up to %.3g", radius);
  const bool stiff = slowest > 0 && radius > 1e6 * slowest;
  return kind + moduli + (stiff ? ", stiff" : "") + (non_normal ? ", non-normal" : "");
}

}  // namespace bromwich

#include "core/result/estimated_quantity.hpp"

#include <cmath>

namespace bromwich {

std::string estimated_quantity(const Result& r) {
  if (!r.error_estimate) return "";
  const bool mean = r.errors ? r.errors->of_integral : r.certificate ? r.certificate->impulses : !r.continuous;
  if (r.certificate && !r.errors) return std::string(mean ? "the mean of y over [0, t]" : "y") + " and x";
  const std::string y = mean ? "the mean of y over [0, t]" : "y";
  if (!r.errors) return r.method == Method::multigrid || r.x.cols() == 0 ? y : y + " and x";
  if (std::isnan(r.errors->states)) return y;
  const bool of_x_alone = *r.error_estimate < r.errors->total();  // only a tolerance of x was given
  return of_x_alone ? "x" : y + " and x";
}

}  // namespace bromwich

#include "files/slope.hpp"

#include <cmath>
#include <numbers>

namespace bromwich {

double derivative(Operation o, double a) {
  using std::numbers::ln10, std::numbers::ln2, std::numbers::inv_sqrtpi;
  const double bell = 2 * inv_sqrtpi * std::exp(-a * a);
  switch (o) {
    case Operation::negative:
      return -1;
    case Operation::sin:
      return std::cos(a);
    case Operation::cos:
      return -std::sin(a);
    case Operation::tan:
      return 1 + std::tan(a) * std::tan(a);
    case Operation::asin:
      return 1 / std::sqrt(1 - a * a);
    case Operation::acos:
      return -1 / std::sqrt(1 - a * a);
    case Operation::atan:
      return 1 / (1 + a * a);
    case Operation::sinh:
      return std::cosh(a);
    case Operation::cosh:
      return std::sinh(a);
    case Operation::tanh:
      return 1 / (std::cosh(a) * std::cosh(a));
    case Operation::exp:
    case Operation::expm1:
      return std::exp(a);
    case Operation::log:
      return 1 / a;
    case Operation::log10:
      return 1 / (a * ln10);
    case Operation::log2:
      return 1 / (a * ln2);
    case Operation::sqrt:
      return 0.5 / std::sqrt(a);
    case Operation::cbrt:
      return 1 / (3 * std::cbrt(a) * std::cbrt(a));
    case Operation::erf:
      return bell;
    case Operation::erfc:
      return -bell;
    case Operation::abs:
      return double(a > 0) - double(a < 0);
    default:  // truth, sign, heaviside, floor, ceil, round
      return 0;
  }
}

double derivative_by_first(Operation o, double a, double b) {
  switch (o) {
    case Operation::add:
    case Operation::subtract:
    case Operation::mod:
      return 1;
    case Operation::multiply:
      return b;
    case Operation::divide:
      return 1 / b;
    case Operation::power:
      return b == 0 ? 0 : b * std::pow(a, b - 1);
    case Operation::atan2:
      return b / (a * a + b * b);
    case Operation::minimum:
      return double(!(b < a));
    case Operation::maximum:
      return double(!(a < b));
    default:  // comparisons
      return 0;
  }
}

double derivative_by_second(Operation o, double a, double b) {
  switch (o) {
    case Operation::add:
      return 1;
    case Operation::subtract:
      return -1;
    case Operation::multiply:
      return a;
    case Operation::divide:
      return -a / (b * b);
    case Operation::power:
      return a == 0 ? 0 : std::pow(a, b) * std::log(a);
    case Operation::atan2:
      return -a / (a * a + b * b);
    case Operation::mod:
      return -std::floor(a / b);
    case Operation::minimum:
      return double(b < a);
    case Operation::maximum:
      return double(a < b);
    default:
      return 0;
  }
}

std::optional<Slope> Slopes::apply(Operation o, const Slope& a, const Slope& b) {
  // A factor that is infinite beside a slope of 0 adds nothing.
  if (!takes_two(o)) {
    const double factor = a.slope == 0 ? 0 : derivative(o, a.value);
    return Slope{bromwich::apply(o, a.value), a.slope * factor};
  }
  double slope = 0;
  if (a.slope != 0) slope += a.slope * derivative_by_first(o, a.value, b.value);
  if (b.slope != 0) slope += b.slope * derivative_by_second(o, a.value, b.value);
  return Slope{bromwich::apply(o, a.value, b.value), slope};
}

}  // namespace bromwich

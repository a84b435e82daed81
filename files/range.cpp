#include "files/range.hpp"

#include "core/base/types.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

constexpr double tiny = std::numeric_limits<double>::min();

/// 0 * inf is 0 here: infinite bounds of a range are not attained.
double product(double a, double b) { return a == 0 || b == 0 ? 0 : a * b; }

/// Whether a number offset + k period lies in the range.
bool meets(Range r, double offset, double period) {
  return std::floor((r.high - offset) / period) >= std::ceil((r.low - offset) / period);
}

/// Exact values are not widened: the slope of t - t is 0.
bool exact_sum(double a, double b, double sum) {
  const double of_b = sum - a;
  return (a - (sum - of_b)) + (b - of_b) == 0;
}
bool exact_product(double a, double b, double found) { return std::fma(a, b, -found) == 0; }

}  // namespace

Range widened(Range r) {
  if (std::isnan(r.low) || std::isnan(r.high)) return {};
  return {r.low - (4 * epsilon * std::abs(r.low) + tiny), r.high + (4 * epsilon * std::abs(r.high) + tiny)};
}

Range hull(Range a, Range b) { return {std::min(a.low, b.low), std::max(a.high, b.high)}; }

Range operator-(Range a) { return {-a.high, -a.low}; }

Range operator+(Range a, Range b) {
  const double low = a.low + b.low, high = a.high + b.high;
  if (exact_sum(a.low, b.low, low) && exact_sum(a.high, b.high, high)) return {low, high};
  return widened({low, high});
}

Range operator-(Range a, Range b) { return a + -b; }

Range operator*(Range a, Range b) {
  if ((a.point() && a.low == 0) || (b.point() && b.low == 0)) return {0, 0};
  if (a.point() && b.point() && exact_product(a.low, b.low, a.low * b.low)) return {a.low * b.low, a.low * b.low};
  const auto [low, high] =
      std::minmax({product(a.low, b.low), product(a.low, b.high), product(a.high, b.low), product(a.high, b.high)});
  return widened({low, high});
}

Range operator/(Range a, Range b) {
  if (b.contains(0)) return {};
  return a * widened({1 / b.high, 1 / b.low});
}

Range increasing(double (*function)(double), Range r) { return widened({function(r.low), function(r.high)}); }

Range range_sin(Range r) {
  constexpr double pi = std::numbers::pi;
  if (!(r.high - r.low < 2 * pi) || std::max(std::abs(r.low), std::abs(r.high)) > 1e12) return {-1, 1};
  const Range wide = widened(r);
  const double a = std::sin(r.low), b = std::sin(r.high);
  const Range found =
      widened({meets(wide, -pi / 2, 2 * pi) ? -1 : std::min(a, b), meets(wide, pi / 2, 2 * pi) ? 1 : std::max(a, b)});
  return {std::max(found.low, -1.0), std::min(found.high, 1.0)};
}

Range range_cos(Range r) {
  const Range shift{std::numbers::pi / 2, std::numbers::pi / 2};
  return range_sin(r + shift);
}

Range range_tan(Range r) {
  constexpr double pi = std::numbers::pi;
  if (!(r.high - r.low < pi) || std::max(std::abs(r.low), std::abs(r.high)) > 1e12 || meets(widened(r), pi / 2, pi))
    return {};
  return widened({std::tan(r.low), std::tan(r.high)});
}

Range range_square(Range r) {
  const double a = r.low * r.low, b = r.high * r.high;
  return widened({r.contains(0) ? 0 : std::min(a, b), std::max(a, b)});
}

Range range_cosh(Range r) {
  const double a = std::cosh(r.low), b = std::cosh(r.high);
  return widened({r.contains(0) ? 1 : std::min(a, b), std::max(a, b)});
}

Range range_power(Range base, Range exponent) {
  if (exponent.point() && exponent.low == std::floor(exponent.low)) {
    const double n = exponent.low;
    if (n == 0) return {1, 1};
    if (n < 0) return base.contains(0) ? Range{} : Range{1, 1} / range_power(base, {-n, -n});
    const double a = std::pow(base.low, n), b = std::pow(base.high, n);
    if (std::fmod(n, 2) != 0) return widened({a, b});
    return widened({base.contains(0) ? 0 : std::min(a, b), std::max(a, b)});
  }
  if (base.low < 0) return {};
  if (exponent.point()) {
    const double a = std::pow(base.low, exponent.low), b = std::pow(base.high, exponent.low);
    return widened({std::min(a, b), std::max(a, b)});
  }
  const auto [low, high] = std::minmax({std::pow(base.low, exponent.low), std::pow(base.low, exponent.high),
                                        std::pow(base.high, exponent.low), std::pow(base.high, exponent.high)});
  return base.low > 0 ? widened({low, high}) : Range{};
}

}  // namespace bromwich

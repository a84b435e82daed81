#include "files/course.hpp"

#include "core/base/types.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace bromwich {

namespace {

constexpr double inf = std::numeric_limits<double>::infinity();

using RangeAndSlope = std::pair<Range, Range>;

bool in_whole_numbers(Operation o) {
  return o == Operation::floor || o == Operation::ceil || o == Operation::round || o == Operation::mod;
}
/// asin, acos
RangeAndSlope arc(Operation o, Range a) {
  const Range inside{std::max(a.low, -1.0), std::min(a.high, 1.0)};
  const Range left = Range{1, 1} - range_square(inside);
  const Range slope =
      widened({1 / std::sqrt(std::max(left.high, 1e-300)), left.low > 0 ? 1 / std::sqrt(left.low) : inf});
  if (o == Operation::asin) return {increasing([](double s) { return std::asin(s); }, inside), slope};
  return {-increasing([](double s) { return -std::acos(s); }, inside), -slope};
}

RangeAndSlope logarithm(Operation o, Range a) {
  if (!(a.low > 0)) return {};
  const double unit = o == Operation::log ? 1 : o == Operation::log10 ? std::log(10.) : std::log(2.);
  const Range per{unit, unit};
  return {increasing([](double s) { return std::log(s); }, a) / per, Range{1, 1} / (a * per)};
}

RangeAndSlope root(Range a) {
  if (!(a.high >= 0)) return {};
  const Range value = increasing([](double s) { return std::sqrt(s); }, {std::max(a.low, 0.0), a.high});
  return {value, {0.5 / value.high * (1 - 8 * epsilon), value.low > 0 ? 0.5 / value.low * (1 + 8 * epsilon) : inf}};
}

/// erf, erfc; the slope of erf is 2 / sqrt(pi) exp(-a^2).
RangeAndSlope error_function(Operation o, Range a) {
  const Range bell = increasing([](double s) { return 1.1283791670955126 * std::exp(s); }, -range_square(a));
  if (o == Operation::erf) return {increasing([](double s) { return std::erf(s); }, a), bell};
  return {-increasing([](double s) { return -std::erfc(s); }, a), -bell};
}

/// Range and slope of a smooth function of one argument.
RangeAndSlope smooth(Operation o, Range a) {
  const Range one{1, 1};
  const auto map = [&](double (*f)(double)) { return increasing(f, a); };
  switch (o) {
    case Operation::sin:
      return {range_sin(a), range_cos(a)};
    case Operation::cos:
      return {range_cos(a), -range_sin(a)};
    case Operation::tan: {
      const Range value = range_tan(a);
      return {value, one + range_square(value)};
    }
    case Operation::asin:
    case Operation::acos:
      return arc(o, a);
    case Operation::atan:
      return {map([](double s) { return std::atan(s); }), one / (one + range_square(a))};
    case Operation::sinh:
      return {map([](double s) { return std::sinh(s); }), range_cosh(a)};
    case Operation::cosh:
      return {range_cosh(a), map([](double s) { return std::sinh(s); })};
    case Operation::tanh: {
      const Range c = range_cosh(a);
      return {map([](double s) { return std::tanh(s); }), one / range_square(c)};
    }
    case Operation::exp:
      return {map([](double s) { return std::exp(s); }), map([](double s) { return std::exp(s); })};
    case Operation::expm1:
      return {map([](double s) { return std::expm1(s); }), map([](double s) { return std::exp(s); })};
    case Operation::log:
    case Operation::log10:
    case Operation::log2:
      return logarithm(o, a);
    case Operation::sqrt:
      return root(a);
    case Operation::erf:
    case Operation::erfc:
      return error_function(o, a);
    default:
      return {};
  }
}

Course quotient(const Course& a, const Course& b) {
  const Range value = a.value / b.value;
  return {a.left / b.left, a.right / b.right, value, (a.slope - value * b.slope) / b.value};
}

Course on_its_way(Operation o, double way, const Course& a, const Course& b) {
  const Range whole{way, way};
  switch (o) {
    case Operation::minimum:
      return way == 0 ? a : b;
    case Operation::maximum:
      return way == 0 ? b : a;
    case Operation::abs:
      return way == 0 ? Course{-a.left, -a.right, -a.value, -a.slope} : a;
    case Operation::mod:
      return {a.left - b.left * way, a.right - b.right * way, a.value - b.value * whole, a.slope - b.slope * whole};
    case Operation::cbrt: {
      const Range value = increasing([](double s) { return std::cbrt(s); }, a.value);
      return {std::cbrt(a.left), std::cbrt(a.right), value, a.slope / (Range{3, 3} * range_square(value))};
    }
    case Operation::atan2:
      return {std::atan2(a.left, b.left), std::atan2(a.right, b.right),
              widened({-3.1415926535897936, 3.1415926535897936}),
              (b.value * a.slope - a.value * b.slope) / (range_square(a.value) + range_square(b.value))};
    default:
      return constant(apply_on(o, way, 0, 0));
  }
}

Course smooth_of_one(Operation o, const Course& a) {
  if (o == Operation::negative) return {-a.left, -a.right, -a.value, -a.slope};
  const auto [value, slope] = smooth(o, a.value);
  return {apply(o, a.left), apply(o, a.right), value, slope * a.slope};
}

Course smooth_of_two(Operation o, const Course& a, const Course& b) {
  Course c{apply(o, a.left, b.left), apply(o, a.right, b.right), {}, {}};
  if (o == Operation::add) {
    c.value = a.value + b.value;
    c.slope = a.slope + b.slope;
  } else if (o == Operation::subtract) {
    c.value = a.value - b.value;
    c.slope = a.slope - b.slope;
  } else if (o == Operation::multiply) {
    c.value = a.value * b.value;
    c.slope = a.slope * b.value + a.value * b.slope;
  } else if (o == Operation::divide) {
    return quotient(a, b);
  } else if (o == Operation::power) {
    c.value = range_power(a.value, b.value);
    const bool fixed = b.slope.point() && b.slope.low == 0 && b.value.point();
    const Range one{1, 1};
    if (fixed)
      c.slope = b.value * range_power(a.value, b.value - one) * a.slope;
    else if (a.value.low > 0)
      c.slope =
          c.value * (b.slope * increasing([](double s) { return std::log(s); }, a.value) + b.value * a.slope / a.value);
  }
  return c;
}

/// The mean value theorem from both ends.
Course tightened(Course c, double width) {
  if (!std::isfinite(c.left) || !std::isfinite(c.right)) return {c.left, c.right, {}, {}};
  const double fall = c.slope.low * width, rise = c.slope.high * width;
  const Range from_left{c.left + std::min(0.0, fall), c.left + std::max(0.0, rise)};
  const Range from_right{c.right - std::max(0.0, rise), c.right - std::min(0.0, fall)};
  const Range both{std::max(from_left.low, from_right.low), std::min(from_left.high, from_right.high)};
  const Range ends{std::min(c.left, c.right), std::max(c.left, c.right)};
  const Range mean = widened(hull(both, ends));
  c.value = hull({std::max(c.value.low, mean.low), std::min(c.value.high, mean.high)}, ends);
  return c;
}

}  // namespace

Course constant(double value) { return {value, value, {value, value}, {0, 0}}; }

Course apply(Operation o, const Course& a, double width) { return tightened(smooth_of_one(o, a), width); }

Course apply(Operation o, const Course& a, const Course& b, double width) {
  return tightened(smooth_of_two(o, a, b), width);
}

Course apply_on(Operation o, double way, const Course& a, const Course& b, double width) {
  return tightened(on_its_way(o, way, a, b), width);
}

double switching(Operation o, double a, double b) {
  if (compares(o) || o == Operation::minimum || o == Operation::maximum) return a - b;
  return o == Operation::mod ? a / b : a;
}

Course switching(Operation o, const Course& a, const Course& b, double width) {
  Course s = a;
  if (o == Operation::mod) s = quotient(a, b);
  if (compares(o) || o == Operation::minimum || o == Operation::maximum)
    s = {a.left - b.left, a.right - b.right, a.value - b.value, a.slope - b.slope};
  return tightened(s, width);
}

double way_of(Operation o, double a, double b) {
  switch (o) {
    case Operation::less:
    case Operation::minimum:
      return double(!(a < b));
    case Operation::less_equal:
      return double(!(a <= b));
    case Operation::greater:
    case Operation::maximum:
      return double(a > b);
    case Operation::greater_equal:
      return double(a >= b);
    case Operation::equal:
    case Operation::not_equal:
      return double(a > b) - double(a < b);
    case Operation::mod:
      return std::floor(a / b);
    case Operation::abs:
    case Operation::heaviside:
    case Operation::cbrt:
    case Operation::atan2:
      return double(a >= 0);
    default:
      return apply(o, a);  // sign, floor, ceil, round
  }
}

double apply_on(Operation o, double way, double a, double b) {
  switch (o) {
    case Operation::less:
    case Operation::less_equal:
      return double(way == 0);
    case Operation::equal:
      return double(way == 0);
    case Operation::not_equal:
      return double(way != 0);
    case Operation::minimum:
      return way == 0 ? a : b;
    case Operation::maximum:
      return way == 0 ? b : a;
    case Operation::mod:
      return a - b * way;
    case Operation::abs:
      return way == 0 ? -a : a;
    case Operation::cbrt:
      return std::cbrt(a);
    case Operation::atan2:
      return std::atan2(a, b);
    default:
      return way;
  }
}

double end_of(Operation o, double way) {
  if (o == Operation::floor || o == Operation::mod) return way + 1;
  if (o == Operation::round) return way + 0.5;
  return o == Operation::ceil ? way : 0;
}

bool one_way(Operation o, Range s) {
  if (!in_whole_numbers(o)) return s.low > 0 || s.high < 0;
  const auto whole = [&](double value) { return o == Operation::mod ? std::floor(value) : apply(o, value); };
  return whole(s.low) == whole(s.high);
}

}  // namespace bromwich

#pragma once
// Interval arithmetic: the range of an operation for all arguments of a range, including rounding.

#include <limits>

namespace bromwich {

struct Range {
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();

  bool contains(double value) const { return low <= value && value <= high; }
  bool point() const { return low == high; }
};

Range operator+(Range, Range);
Range operator-(Range, Range);
Range operator-(Range);
Range operator*(Range, Range);
Range operator/(Range, Range);  ///< all numbers if the divisor may be 0

/// Between the values of an increasing function at the ends; all numbers if one of them is NaN.
Range increasing(double (*function)(double), Range);
Range widened(Range);  ///< by rounding
Range hull(Range, Range);

Range range_sin(Range);
Range range_cos(Range);
Range range_tan(Range);
Range range_cosh(Range);
Range range_square(Range);
Range range_power(Range base, Range exponent);

}  // namespace bromwich

#pragma once
// Axes: from values to positions in a picture, and the ticks between.

#include <string>
#include <vector>

namespace bromwich::report {

/// Text in HTML and SVG.
std::string escaped(const std::string& text);

/// "0.25", "1e−6": at most `digits` digits.
std::string short_number(double value, int digits = 6);

/// A unit with its prefix, and how many units it is: "µs", 1e-6.
struct ScaledUnit {
  std::string name;
  double size = 1;
};

/// For values up to `largest`. Units that take no prefix (mm, h), and sizes that are read without one, stay as they
/// are.
ScaledUnit with_prefix(const std::string& unit, double largest);

struct Tick {
  double value = 0;
  std::string label;  ///< may be empty
};

/// Values lo..hi at positions from..to, linear or logarithmic (0 < lo).
class Scale {
 public:
  Scale(double lo, double hi, double from, double to, bool logarithmic = false);

  double operator()(double value) const;
  /// About `count` ticks at multiples of 1, 2 or 5 times a power of ten; a logarithmic scale has powers of ten, and
  /// where it spans less than two, their multiples by 2 and 5.
  std::vector<Tick> ticks(int count) const;

  double lo() const { return lo_; }
  double hi() const { return hi_; }
  double from() const { return from_; }
  double to() const { return to_; }

 private:
  std::vector<Tick> decades(int count) const;

  double lo_, hi_, from_, to_;
  bool logarithmic_;
};

/// A range of values for an axis.
struct Range {
  double lo = 0, hi = 1;
};

/// Whether lo < hi by more than rounding.
bool apart(double lo, double hi);

/// The range of all finite values, somewhat wider, and from 0 where that is near; 0 to 1 without values. Logarithmic:
/// whole decades around the positive ones.
Range range_of(const std::vector<double>& values, bool logarithmic = false);

}  // namespace bromwich::report

#pragma once
// The error of a sequence of grids from the differences of consecutive ones, the step halved from one to the next.
//
// symbol  variable      meaning
// d_k     differences_  how far the solution on grid k+1 is from that on grid k, at the points of grid k
// p       order()       slope of -log2 d over the last three differences, log2(d_{k-2} / d_k) / 2, within [1/2, q]
// q       highest_      order of the discretisation where the solution is smooth
// e       error()       of the finer grid: D / (2^p - 1) with D = max(d_k, (d_{k-2} d_{k-1} d_k)^{1/3} 2^-p, d_{k-1}
// 2^-q)
//
// The slope does not depend on d_{k-1}, and the mean of three smoothes what the place of a switch between two grid
// points does to each: differences of piecewise smooth solutions fall irregularly, by factors of 2 from their trend. A
// d_k that falls faster than with the full order is small by chance and counts as d_{k-1} / 2^q at least.

#include <cmath>
#include <vector>

namespace bromwich {

class GridDifferences {
 public:
  /// `order`: q.
  explicit GridDifferences(double order) : highest_(order) {}

  void add(double difference) { differences_.push_back(difference); }

  double order() const;  ///< p; NaN before two differences
  double error() const;  ///< e; NaN before two differences
  /// Error of a grid with J steps from its difference `d` to one with 3J/4, whose points the jumps of y do not share.
  /// Errors of the two that have nothing to do with each other make d as large as the larger one, (4/3)^p e.
  double error_from_check(double d) const { return d * std::pow(0.75, order()); }
  /// Two orders have been observed, so that one does not rest on chance.
  bool confirmed() const { return differences_.size() >= 3; }
  /// The last two halvings have not halved the difference: it does not converge, or not yet.
  bool stands_still() const;
  /// The smallest of the last `window` differences is not half of the smallest of the `window` before: it will not
  /// converge. Jumps make single differences irregular.
  bool stalled(std::size_t window) const;
  /// How often the step has to be halved at least, if the full order comes, for an error of `tolerance`.
  double halvings_to(double tolerance) const;
  double last() const { return differences_.back(); }

 private:
  double believed(std::size_t k) const;

  double highest_;
  std::vector<double> differences_;
};

}  // namespace bromwich

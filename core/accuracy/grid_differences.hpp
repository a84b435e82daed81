#pragma once
// The error of a sequence of grids from the differences of consecutive ones, the step halved from one to the next.
//
// symbol  variable      meaning
// d_k     differences_  how far the solution on grid k+1 is from that on grid k, at the points of grid k
// p       order()       slope of -log2 d over the last three differences, log2(d_{k-2} / d_k) / 2, within [1/2, q]
// q       highest_      order of the discretisation where the solution is smooth
// e       error()       of the finer grid: D / (2^p - 1) with
//                       D = max(d_k, m, d_{k-1} 2^-q),  m = (d_{k-2} d_{k-1} d_k)^{1/3} 2^-p
//
// Errors of piecewise smooth solutions are h^q times a number that depends on where switches fall between grid points.
// Differences lie within a factor s = sqrt(2) or so of their trend. Where they are farther from it, a slope below 1 is
// chance, since switches at any place do not lower the order further. The slope does not depend on d_{k-1}, and the
// mean of three, m, smoothes the rest. An order with which e is at most s times its value for q cannot be distinguished
// from q and counts as q. A d_k that falls faster than with the full order is small by chance and counts as d_{k-1}
// 2^-q at least. A comparison with another grid would show such a chance, and d_k is mistrusted half as much then: D =
// (d_k max(d_k, m))^{1/2}.

#include <vector>

namespace bromwich {

class GridDifferences {
 public:
  /// `order`: q.
  explicit GridDifferences(double order) : highest_(order) {}

  void add(double difference) { differences_.push_back(difference); }
  /// From now on q is at most `order`.
  void limit_order(double order);

  double order() const;  ///< p; NaN before two differences
  /// The slope itself, whatever q; NaN where the differences do not show one (fewer than three, zero, rounding).
  double observed_order() const;
  /// e; NaN before two differences. `checked`: error_from_check is known too.
  double error(bool checked = false) const;
  /// Error of a grid with J steps from its difference `d` to one with 3J/4, whose points the jumps of y do not share.
  /// Errors of the two that have nothing to do with each other make d as large as the larger one, (4/3)^p e.
  double error_from_check(double d) const;
  /// Two orders have been observed, so that one does not rest on chance.
  bool confirmed() const { return differences_.size() >= 3; }
  /// They have, and the last three differences are below a hundredth of the goal: whether they fall, or are rounding,
  /// does not matter.
  bool negligible(double goal) const;
  /// They have, and are the same to a quarter.
  bool regular() const;
  /// The last two differences differ by a factor that no order makes (100): the grid before did not resolve the
  /// solution, or chance has a part in one of the two. Differences by rounding, below 1e-11, do not count.
  bool changes_abruptly() const;
  /// The last two halvings have not halved the difference: it does not converge, or not yet.
  bool stands_still() const;
  /// The smallest of the last `window` differences is not half of the smallest of the `window` before. Jumps make
  /// single differences irregular.
  bool stalled(std::size_t window) const;
  /// How often the step has to be halved for an error of `tolerance`, with the order that was seen, at least 1/2.
  double halvings_to(double tolerance) const;
  /// The same with order 1 at least: steps that do not resolve a solution yet show less than it has.
  double fewest_halvings_to(double tolerance) const;
  double last() const { return differences_.back(); }
  /// The larger of the last two differences, as it would be on the last grid with first order; 0 before one.
  double largest_recent() const;

 private:
  double believed(std::size_t k) const;

  double highest_;
  std::vector<double> differences_;
};

}  // namespace bromwich

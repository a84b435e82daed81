#pragma once
// Error control: the step is halved until the error, estimated from the grids themselves, is below a tolerance.
//
// symbol  variable      meaning
// d_k     differences   max_j |y^k(t_j) - y^{k+1}(t_j)|_inf over the t_j > 0 of grid k, relative to max(1, max |y|)
// p_k     order()       log2(d_{k-1} / d_k), within [1/2, order of the discretisation]
// e       error()       of the finer grid: d_k / (2^p - 1), p the smaller of the last two p_k
//
// y_0 does not depend on the grid and is left out; an error in the first steps counts like any other, at the time
// points that a grid has. A switch that happens to fall on a grid point makes a difference small by chance: d_k counts
// as d_{k-1} / 2^order at least. To the discretisation come the error of the weights (kernel_error |y|) and that of the
// iteration, c/(1 - c) times the last change where sweeps contract by c.
//
// Where y jumps, a jump that moves by a step is a difference as large as the jump on every grid. There the mean of y
// over [0, t], h/T Σ_{i<=j} y_i, takes the place of y: of first order. That a jump stays in the same step when the step
// is halved has a chance of one half: there three differences are remembered, with order 1 for x too.

#include "solve.hpp"

namespace bromwich {

/// Differences of consecutive grids, the step halved from one to the next.
class GridDifferences {
 public:
  /// `order`: of the discretisation where the solution is smooth. `memory`: how many differences before the last one
  /// bound it from below.
  explicit GridDifferences(double order, std::size_t memory = 1) : highest_(order), memory_(memory) {}

  void add(double difference) { differences_.push_back(difference); }

  double order() const;  ///< p; NaN before two differences
  double error() const;  ///< e; NaN before two differences
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
  double counted(std::size_t k) const;
  double order_at(std::size_t k) const;

  double highest_;
  std::size_t memory_;
  std::vector<double> differences_;
};

/// What the sweeps after the last one would still change, from the changes of all sweeps.
double iteration_error(const std::vector<double>& history);

/// `solve` with options.tolerance > 0: solves on J, 2J, 4J, ... steps, J = options.steps or as often half of the
/// scene's default as leaves 16 steps and an integer. Returns the finest grid: `solved` where the estimate, with two
/// observed orders behind it, is below 0.8 of the tolerance (a fifth is left for the estimate to err), otherwise
/// tolerance_not_met with what stood in the way. Counts are those of the finest grid, seconds those of all.
Result solve_to_tolerance(const Scene&, Backend&, const Options&);

}  // namespace bromwich

#pragma once
// How the results of one method on grids of J, 2J, 4J, ... steps approach each other: y, its mean over [0, t] where y
// jumps, and the states.
//
// Where y jumps, a jump that moves by a step is a difference as large as the jump on every grid. The mean 1/T ∫_0^t y
// then takes the place of y; its error is of first order. x is integrated and converges with an order between 1 and 2.
// When the step is halved, a jump stays at its grid point with a chance of one half. The difference then does not show
// the error that the jump makes. Two rules account for it. A jump s is known to within a step, so the mean is taken to
// have an error of at least s h/(2 T). x is taken to have an error of up to |B s| h if its differences rise or fall by
// a factor of 100 from one to the next, which shows that they are a matter of chance. (Where y holds the state on a
// constraint, x is more accurate.) Jumps where sources jump are not meant, if steps are divided there. And a grid of
// 3J/4 steps, the check, has few time points in common with the others. March over impacts locates them: its jumps are
// known to the square of the step, and the mean of y and x have order 2.

#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "grid_differences.hpp"

#include <optional>

namespace bromwich {

/// What errors are measured against: component i of a kind (y, its mean, x) by
///
///     s_i = max(max_t |c_i|, 1e-3 max_k max_t |c_k|, rounding / tolerance) + absolute,
///
/// all in natural units (core/solve/scaling.hpp), in which the terms of the equations have size 1. What rounding of
/// these terms leaves where they cancel, such as the voltage that ideal diodes hold at 0, is no relative error.
struct ComponentSizes {
  static constexpr double smallest = 1e-3;  ///< of the largest component, that a component is measured against

  Vector one_y, one_x;  ///< what 1 in the user's units is for y (n) and for the recorded x; empty = 1
  Vector seen_y = {},
         seen_x = {};    ///< largest values between the rows, n and one for each recorded x; empty = none known
  double absolute = 0;   ///< absolute tolerance over the relative one, in the user's units
  double zero = 0;       ///< smaller values are rounding: that of terms of size 1, over the relative tolerance
  bool relative = true;  ///< false: 1 in the user's units alone, for all

  /// s_i of components with these largest values; `one`: what 1 in the user's units is for them, empty = 1.
  Vector of(const Vector& largest, const Vector& one = {}) const;
  Vector of_y(const Result&) const;
  Vector of_mean(const Result&) const;
  Vector of_x(const Result&) const;
};

/// Largest differences at common time points t > 0, each relative to the s_i of `b`. Infinite where one of the two is
/// not known.
struct Distance {
  double y, mean;
  Vector x;  ///< a component each

  double of_x() const { return x.size() > 0 ? x.maxCoeff() : 0; }
};
/// Row a_stride j of `a` belongs to the time of row b_stride j of `b`. Rows of `a` beside its impacts are on the side
/// of those of `b` (impact_sides.hpp).
Distance distance(const Result& a, Index a_stride, const Result& b, Index b_stride, const ComponentSizes& = {});

/// The largest v_i / size_i; those with v_i = 0 do not count.
double largest_share(const Vector& v, const Vector& size);

/// n: of each component the largest min(|y_j - y_{j-1}|, |y_{j+1} - y_{j-2}|), j >= 3: an impulse, one row that stands
/// out, is no jump. `known`, by row: jumps from the row before that are where sources jump, which do not count.
Vector largest_jumps(const RowMatrix& y, const std::vector<bool>& known = {});

/// n: of each component the largest min(|y_j - y_{j-1}|, |y_j - y_{j+1}|), j >= 2: a row that stands out,
/// other than between known jumps.
Vector largest_peaks(const RowMatrix& y, const std::vector<bool>& known = {});

class Convergence {
 public:
  /// On the first grid, which later ones of the same method follow.
  Convergence(const Scene&, const Result& first, ComponentSizes = {});

  /// The next grid, with half the step of `coarse`. `resolved`: with so many steps, differences that do not converge
  /// mean a jump.
  void add(const Result& coarse, const Result& fine, bool resolved);

  /// Whether the error of the last grid has to be compared with a grid of 3/4 of its steps; and the comparison.
  bool wants_check() const { return may_jump_ && !check_; }
  void check(const Result& other, const Result& fine);
  /// Whether the error is below `goal` but for jumps that are known to within a step, which the check may show.
  bool hangs_on_check(double goal) const;

  /// The error of the finer of the last two grids from their difference, with a margin.
  double share_of_difference() const;
  bool of_integral() const { return jumps_; }  ///< the mean of y is controlled, not y
  const GridDifferences& controlled() const { return jumps_ ? mean_ : y_; }
  const GridDifferences& states() const { return x_; }
  double error() const;  ///< of what is controlled, on the last grid; NaN before two differences
  /// Likewise. The largest component may hide one that converges more slowly; where differences are regular, their
  /// orders tell that of each.
  double error_of_x() const;
  bool can_be_judged(double goal) const;  ///< what is controlled converges, as far as can be seen

 private:
  double by_displaced_jumps(double most, const GridDifferences&, double to_check) const;

  GridDifferences y_, mean_, x_, jump_;
  std::vector<GridDifferences> components_;  ///< of x
  std::optional<Distance> check_;
  const Scene& scene_;
  ComponentSizes sizes_;
  bool may_jump_, jumps_, erratic_ = false;
  double displaced_ = 0, displaced_x_ = 0;  ///< errors of the mean and of x by jumps that are known to within a step
};

}  // namespace bromwich

#pragma once
// Multigrid in time for 0 <= y  ⊥  M y + K y + r >= 0: a full approximation scheme with the functional iteration as its
// smoother. On a grid, with R the values at the points of the next coarser one and I the linear interpolation back:
//
//     smooth          y <- SOL(M, r + K y)
//     coarse problem  y_c in SOL(M, r_c + K_c y_c),   r_c = R (r + K y) - K_c R y
//     correct         y <- y + I (y_c - R y)
//     smooth
//
// R y of a solution y solves its coarse problem, so that y is left as it is. R has to be injection: averages of y and w
// over time are not complementary where the active set changes. The coarsest grid is marched. The start comes from the
// coarse grids (nested iteration).

#include "time_levels.hpp"

namespace bromwich {

class Multigrid {
 public:
  /// Counters, sweeps and seconds go to `result`.
  Multigrid(Backend& backend, const Options& options, TimeLevels& levels, Result& result)
      : backend_(backend), options_(options), levels_(levels), result_(result) {}

  /// From y_0 alone to a first y on the finest grid. Returns y of the grids below it, the finer first, at most two.
  std::vector<RowMatrix> nest(const Vector& y0);

  /// Cycles on the finest grid until y stands still.
  IterationOutcome iterate();

  /// One V-cycle for the y and r that grid l holds.
  void cycle(std::size_t l);

 private:
  void smooth(TimeLevel&);
  void march(TimeLevel&);
  void pose_coarse_problem(TimeLevel& fine, TimeLevel& coarse);
  void count(const LcpCount&);
  RowMatrix download(const Array&);

  Backend& backend_;
  const Options& options_;
  TimeLevels& levels_;
  Result& result_;
  std::optional<IterationOutcome> failure_;  ///< what ended a sweep or a march; nothing is done after it
};

/// Fills everything that solve_by_iteration does, cycles and error_estimate too. `kernel`: that of sparse dynamics, or
/// null. False where there are no grids to cycle on; nothing is done then.
bool solve_by_multigrid(const DiscreteProblem&, const SparseKernel* kernel, const Options&, Result&);

}  // namespace bromwich

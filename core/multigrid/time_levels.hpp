#pragma once
// The time grids of a multigrid method: J, J/2 and J/4 steps, from which its errors are estimated, and further grids as
// far as they are useful. If sweeps smooth well, the next grid may have far fewer than half the steps.
//
// symbol    variable   shape          meaning
// K         kernel     -              discrete convolution of this grid
// r         r          (J_l+1) x n    right-hand side of this grid's problem y in SOL(M, r + K y)
// y         y          (J_l+1) x n    its iterate; row 0 is y_0 and never changes
// v         v          (J_l+1) x n    K y
// y~        old        (J_l+1) x n    y at the start of the cycle, or before the last sweep of the finest grid
// y_h       nested     (J_l+1) x n    y from the nested iteration; on the two grids below the finest
//
// A grid with two stages in each step (core/multigrid/dual_levels.hpp) has 2J_l + 1 rows, of which every second is the
// end of a step.
//
// D         shift      1              smoothing solves LCP(M + D I, .), see core/multigrid/smoothing.hpp

#include "../iteration/functional_iteration.hpp"
#include "../kernel/changes.hpp"
#include "sweeps_in_turn.hpp"

#include <functional>
#include <optional>
#include <vector>

namespace bromwich {

struct TimeLevel {
  Index steps = 0;
  SharedWeights weights;  ///< see core/kernel/weights.hpp for those of coarser grids
  std::shared_ptr<SpaceTimeKernel> kernel;
  std::unique_ptr<Array> r, y, v, old, nested;
  std::unique_ptr<Array> first_v;  ///< K R y of the coarse problem posed here, if the finer grid is lazy; else null
  std::unique_ptr<Array> ends;     ///< like `nested`, if that has only the ends of steps; null: `old` is used
  std::unique_ptr<LcpBatch> lcp;   ///< with M + D I; null on a coarsest grid that is always marched
  SweepsInTurn* turns = nullptr;   ///< `lcp`, if its sweeps differ
  double shift = 0;
  int sweeps = 0;           ///< before the coarse problem; one more follows it. On the coarsest: all of a visit
  int coarsest_sweeps = 0;  ///< per visit, if this grid is the coarsest
  int first_visits = 0;     ///< visits at the start, if this grid is the coarsest
  std::size_t coarse = 0;   ///< the grid of the coarse problem of a cycle on this one
  int passes = 1;           ///< over the unknowns in one sweep, see Result::passes
  bool lazy = false;        ///< v of its grid is interpolated after the coarse problem, see Multigrid
  bool staged = false;      ///< two stages in each step, the coarse grid has the same steps
  bool starts = true;       ///< takes part in the nested start
  /// Cycles at the start where errors are estimated: the algebraic error that a grid below the finest leaves counts as
  /// discretisation error.
  int cycles_at_start = 1;
  double unseen = 0;  ///< smoothing factor for error components invisible to the grid `coarse`
  /// P - P_c, P_c of its coarse grid, where P in place of M differs from grid to grid (core/multigrid/dual_levels.hpp),
  /// and an array for it on that grid; null otherwise.
  std::unique_ptr<Convolution> matrix_change;
  std::unique_ptr<Array> matrix_term;
  std::unique_ptr<March> march;  ///< of the coarsest grid only, instead of sweeps

  std::size_t bytes() const;
};

struct TimeLevels {
  std::vector<std::unique_ptr<TimeLevel>> grids;  ///< finest first; pointers to them stay valid
  std::string description;                        ///< of the kernel and the grids
  KernelPlan finest;                              ///< of the finest grid
  double kernel_error = 0;                        ///< see Result::kernel_error
  /// Errors are estimated from the first three grids. Empty: where there are three; otherwise it says so.
  std::optional<bool> related = {};
  bool estimates() const { return related.value_or(grids.size() >= 3); }
  /// Sets r of all grids from x0, f and g, of which some have changed; returns kernel_error.
  std::function<double(const Changes&)> take_sources;
  std::function<void()> respond;        ///< sets r of all grids below the finest
  std::function<void()> prepare_march;  ///< of the coarsest grid, instead of the sweeps there

  TimeLevel& operator[](std::size_t l) { return *grids[l]; }
  const TimeLevel& operator[](std::size_t l) const { return *grids[l]; }
  std::size_t size() const { return grids.size(); }
};

/// A coarser grid needs BackendTraits::fewest_steps, and kappa_0 (core/iteration/forecast.hpp) below 0.1. kappa_0 below
/// 1 is enough where the symbol of a sweep (core/multigrid/smoothing.hpp) is known to be at most 1 at frequency 0 and
/// below 0.8 at the high ones. M + W_0 is P there. A cycle takes the coarsest grid for which a sweep multiplies the
/// errors invisible to that grid by `far_smoothed` at most, or else the next grid. There are no levels if only the
/// finest grid is left and it is too long to be marched in every cycle. The operator has to outlive them. The coarsest
/// grid is swept where the symbol is known, and marched otherwise. r holds the response on each grid, y is zero.
TimeLevels time_levels(TimeOperator&, const Options&);

inline constexpr Index enough_steps = 96;     ///< of the coarsest of three grids or more, where it is swept
inline constexpr Index most_marched = 64;     ///< of a finest grid that is the only one
inline constexpr double far_smoothed = 0.15;  ///< TimeLevel::unseen of a cycle that leaves out grids

}  // namespace bromwich

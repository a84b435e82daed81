#pragma once
// The time grids of a multigrid method: J, J/2, J/4 steps, from which its errors are estimated, and then as many as are
// of use: where sweeps smooth well, the next grid may have far fewer steps than half.
//
// symbol    variable   shape          meaning
// K         kernel     -              discrete convolution of this grid
// r         r          (J_l+1) x n    right-hand side of this grid's problem y in SOL(M, r + K y)
// y         y          (J_l+1) x n    its iterate; row 0 is y_0 and never changes
// v         v          (J_l+1) x n    K y
// y~        old        (J_l+1) x n    y as the cycle found it, or before the last sweep of the finest grid
// y_h       nested     (J_l+1) x n    y that the nested iteration came to; of the two grids below the finest
// D         shift      1              smoothing solves LCP(M + D I, .), see core/multigrid/smoothing.hpp

#include "../iteration/functional_iteration.hpp"
#include "../kernel/changes.hpp"

#include <functional>
#include <vector>

namespace bromwich {

struct TimeLevel {
  Index steps = 0;
  SharedWeights weights;  ///< see core/kernel/weights.hpp for those of coarser grids
  std::shared_ptr<SpaceTimeKernel> kernel;
  std::unique_ptr<Array> r, y, v, old, nested;
  std::unique_ptr<LcpBatch> lcp;  ///< with M + D I; not of a coarsest grid that is marched from the start
  double shift = 0;
  int sweeps = 0;                ///< before a coarser grid is asked; one follows. On the coarsest: all of a visit
  int coarsest_sweeps = 0;       ///< of a visit, were this grid the coarsest
  int first_visits = 0;          ///< to it before anything else, were it the coarsest
  std::size_t coarse = 0;        ///< the grid that a cycle on this one asks
  double unseen = 0;             ///< smoothing factor for error components invisible to the grid `coarse`
  std::unique_ptr<March> march;  ///< of the coarsest grid only, in place of sweeps

  std::size_t bytes() const;
};

struct TimeLevels {
  std::vector<std::unique_ptr<TimeLevel>> grids;  ///< finest first; what points to one stays valid
  std::string description;                        ///< of the kernel and the grids
  KernelPlan finest;                              ///< of the finest grid
  double kernel_error = 0;                        ///< see Result::kernel_error
  /// Sets r of all grids from x0, f and g, of which some have changed; returns kernel_error.
  std::function<double(const Changes&)> take_sources;
  std::function<void()> respond;        ///< sets r of all grids below the finest
  std::function<void()> prepare_march;  ///< of the coarsest grid, instead of the sweeps there

  TimeLevel& operator[](std::size_t l) { return *grids[l]; }
  const TimeLevel& operator[](std::size_t l) const { return *grids[l]; }
  std::size_t size() const { return grids.size(); }
};

/// A coarser grid needs `fewest_steps`, and kappa_0 (core/iteration/forecast.hpp) below 0.1; or below 1 where the
/// symbol of a sweep (core/multigrid/smoothing.hpp) is known, at most 1 at frequency 0 and below 0.8 at the high ones.
/// M + W_0 is P there. A cycle asks the coarsest one for which a sweep multiplies what that cannot see by
/// `far_smoothed` at most, or the next one. None where that leaves but the finest, and it is too long to be marched in
/// every cycle. The operator has to outlive them. The coarsest grid is swept where the symbol is known, and marched
/// otherwise. r holds the response on each grid, y is zero.
TimeLevels time_levels(TimeOperator&, const Options&);

inline constexpr Index fewest_steps = 16;            ///< of a grid but the finest
inline constexpr Index fewest_steps_on_device = 48;  ///< small grids cost a device as much as large ones
inline constexpr Index enough_steps = 96;            ///< of the coarsest of three grids or more, where it is swept
inline constexpr Index most_marched = 64;            ///< of a finest grid that is the only one
inline constexpr double far_smoothed = 0.15;         ///< TimeLevel::unseen of a cycle that leaves out grids

}  // namespace bromwich

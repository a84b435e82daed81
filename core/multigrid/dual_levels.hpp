#pragma once
// The time grids of cycles in w (core/dual/dual_weights.hpp). They are TimeLevels like those of cycles in y, with P in
// place of M, V - P delta in place of K and s in place of r. So y, v and r of a TimeLevel hold w, (V - P delta) w and
// s. Two things differ. The smoother is a projected step or LCP(P, .), where the primal form solves LCP(M + D I, .).
// Coarse grids exist down to BackendTraits::fewest_steps, since V_0 alone decides. The coarsest grid is marched.
//
// Stages of Radau IIA do not nest: the stages of a step of 2h are not stages of steps of h. A grid with stages has as
// its coarse grid that of implicit Euler with the same step; they share the ends of the steps (defect correction).
// Coarser grids use implicit Euler on longer steps. J, J/2 and J/4 steps with stages give the nested start and the
// estimates of errors.

#include "../dual/dual_operator.hpp"
#include "time_levels.hpp"

#include <string>

namespace bromwich {

struct DualLevels {
  TimeLevels levels;                      ///< empty if refused
  std::string refusal;                    ///< why
  std::vector<LcpMatrix> P;               ///< of the grids; never moved
  std::vector<std::unique_ptr<Array>> s;  ///< of the grids below the finest with sources; cycles overwrite their r
  DualResponse* finest = nullptr;         ///< K of the finest grid
  Vector row_scale;                       ///< of V and s on all grids (core/dual/dual_weights.hpp); empty: none
  Index stages = 1;                       ///< of the finest grid
  double contraction = 0;                 ///< forecast of a cycle: the largest of all grids

  /// What the grids refer to, in the order in which it is made.
  struct Grid {
    std::unique_ptr<DiscreteProblem> problem;  ///< null: that of the operator
    std::unique_ptr<TimeOperator> op;
    std::unique_ptr<DualResponse> response;  ///< null: the grid is only a coarse one of others
  };
  std::vector<Grid> grids;
};

/// Cycles in w for the problem of the operator, which must outlive them, with one stage or two. The pointer is never
/// null; see `refusal`.
std::unique_ptr<DualLevels> dual_levels(TimeOperator&, Index stages, const Options&);

inline constexpr Index most_marched_dual = 128;  ///< steps of a coarsest grid

}  // namespace bromwich

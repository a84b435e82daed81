#pragma once
// The steps of a march in stages: steps of the grid, some of them divided into parts, at jumps of sources, in boundary
// layers and at contacts.

#include "../host/stage_march.hpp"
#include "../kernel/discrete_problem.hpp"

#include <map>
#include <vector>

namespace bromwich {

inline constexpr double same_at_end = 1e-9;  ///< relative to the largest: values of g that count as equal

struct StageGrid {
  Vector t;                     ///< end times of the steps, t[0] = 0
  std::vector<double> lengths;  ///< length of the step to row j at index j - 1; empty if no step is divided
  /// Where sources are looked at for the step to row j, at index j - 1: the step itself, but for parts of few lengths
  /// (core/march/dyadic_parts.hpp). As many as lengths.
  std::vector<double> from, to;
  std::vector<Index> step;   ///< grid step that contains row j
  std::vector<Index> at;     ///< row of each grid point
  std::vector<Index> after;  ///< rows of brief parts that take g from after the jump at their grid point
};

/// Steps of the undivided grid with a new contact of a rigid constraint, each with the predicted time of the contact,
/// or NaN.
///
/// Implicit Euler moves the state onto the constraint by the end of a step. If y acts on the second derivative of w,
/// the remaining velocity is that of this motion, and only the next step removes it. Short parts just after the contact
/// do the same, so the motion continues from there and not from the end of the step. Without a predicted time the short
/// parts are at the end of the step.
using Contacts = std::map<Index, double>;

/// Whether M determines y. g and y at points of the grid are then their limits from the left, and y jumps where g does.
bool takes_limits_at_points(const DiscreteProblem&);

/// The boundary layers that parts resolve: none; those behind impulses, which are at jumps of g inside steps if M
/// leaves y to the dynamics; these and one at t = 0, where the state jumps; or those behind all jumps and at t = 0, for
/// grids whose error is controlled.
enum class LayersOf { nothing, impulses, impulses_and_start, all_jumps };

/// With two stages.
StageGrid make_grid(const DiscreteProblem&, Index stages, LayersOf, const Contacts& = {});

/// The contacts of a march on a grid, `g` at its stages. Empty if steps are not divided, or if there are too many
/// contacts. The time of a contact is predicted from the three rows before it.
Contacts contacts_of(const StageGrid&, const StageSolution&, const RowMatrix& g);

}  // namespace bromwich

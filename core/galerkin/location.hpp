#pragma once
// Event location. A switch of the active set inside an interval costs y half an order and x one order; a switch on a
// node costs nothing. core/result/switching.hpp finds the times of switches up to O(h^2) where y leaves 0 with a slope.
// Nodes are placed at these times, with intervals of one length between them. A kink is then at most O(h^2) from its
// node, which leaves an error of h^3 in y (L2) and of h^4 in x. So do jumps and kinks of f and g, whose times are
// known: with boundary values, intervals are divided there.

#include "../result/result.hpp"
#include "discretisation.hpp"

namespace bromwich {

struct LocatedGrid {
  std::vector<GridPart> parts;
  Index located = 0;  ///< switches on nodes
  Index missed = 0;   ///< switches without a node: y jumps there, or is active for less than an interval
};

/// N intervals, divided at the breakpoints of f and g, where y has a kink or jumps.
struct BrokenGrid {
  std::vector<GridPart> parts;
  std::vector<Index> of;    ///< by interval: which of the N intervals it is part of
  std::vector<Index> kept;  ///< N+1: the nodes of the N intervals
  bool divided() const { return parts.size() > 1; }
};
BrokenGrid divide_at_breakpoints(const Scene&, Index N);

/// A result on the parts as one on the N intervals: y at their ends, with the integral over all parts.
void keep_nodes(const BrokenGrid&, Result&);

/// From a solved result of method galerkin; intervals are about as long as T/N. `breakpoints`: of the scene, at nodes
/// of the result; they stay nodes.
LocatedGrid locate_switches(const Scene&, const Result&, const std::vector<double>& breakpoints, Index N);

/// Whether both have the same numbers of intervals, and ends no farther apart than `apart`.
bool same_grid(const std::vector<GridPart>&, const std::vector<GridPart>&, double apart);

/// z of the result in the middle of the intervals of another grid, a_k = b_k: its first active sets.
RowMatrix coefficients_on(const Result&, const GalerkinProblem&);

}  // namespace bromwich

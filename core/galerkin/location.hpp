#pragma once
// Event location: a switch of the active set inside an interval costs half an order of y and one of x, on a node
// nothing. core/result/switching.hpp knows them to O(h^2) where y leaves 0 with a slope. With nodes at these times and
// intervals of one length in between, a kink lies at most O(h^2) off its node: of y this is h^3 in L2, of x it is h^4.

#include "../result/result.hpp"
#include "discretisation.hpp"

namespace bromwich {

struct LocatedGrid {
  std::vector<GridPart> parts;
  Index located = 0;  ///< switches on nodes
  Index missed = 0;   ///< left where they are: y jumps there, or is active for no whole interval
};

/// From a solved result of method galerkin; intervals are about as long as T/N.
LocatedGrid locate_switches(const Scene&, const Result&, Index N);

/// The same numbers of intervals, and ends that are no farther apart than `apart`.
bool same_grid(const std::vector<GridPart>&, const std::vector<GridPart>&, double apart);

/// z of the result in the middle of the intervals of another grid, (a_k, b_k) alike: where its active sets begin.
RowMatrix coefficients_on(const Result&, const GalerkinProblem&);

}  // namespace bromwich

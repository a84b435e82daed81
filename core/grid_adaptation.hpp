#pragma once
// The cycle of goal-oriented refinement, whatever is solved on the grids.

#include "goal.hpp"

#include <functional>

namespace bromwich {

/// `cells` equal cells on [0, T], with `breaks` (0 < t < T) among the points.
Vector first_grid(double T, Index cells, const std::vector<double>& breaks);

/// Doerfler: the fewest cells that carry the share `marking` of Σ |indicators|, at most `most`, in increasing order.
/// None where all indicators are 0.
std::vector<Index> marked_cells(const Vector& indicators, double marking, Index most);

/// The cells to halve, those with the largest |indicators|, as many as make M^q Σ |indicators| least, by the law that
/// what a cell contributes falls by 2^-q: half of the cells of a grid where all contribute alike would be a waste.
std::vector<Index> economical_cells(const Vector& indicators, int q, Index most);

/// Halves the marked cells; those of a few roundings of T are left as they are.
Vector bisected(const Vector& t, const std::vector<Index>& marked);

struct AdaptedGrid {
  Vector t;
  GoalEvaluation last;
  std::vector<GoalCycle> history;
  Status status = Status::solved;
  std::string reason;
};

/// Evaluates and refines until the cycles, cells or tolerance asked for. `default_cells` where nothing is.
AdaptedGrid adapt_grid(Vector t, const Options&, const GoalOptions&, const QuantityOfInterest&, Index default_cells,
                       const std::function<GoalEvaluation(const Vector& t)>& evaluate);

}  // namespace bromwich

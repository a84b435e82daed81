#pragma once
// The cycle of goal-oriented refinement, whatever is solved on the grids.

#include "../result/options.hpp"
#include "../result/result.hpp"
#include "options.hpp"

#include <functional>
#include <vector>

namespace bromwich {

/// `cells` equal cells on [0, T], with `breaks` (0 < t < T) among the points.
Vector first_grid(double T, Index cells, const std::vector<double>& breaks);

/// Doerfler: the fewest cells that carry the share `marking` of Σ |indicators|, at most `most`, in increasing order.
/// None where all indicators are 0.
std::vector<Index> marked_cells(const Vector& indicators, double marking, Index most);

/// The cells to halve, those with the largest |indicators|, as many as make M^q Σ |indicators| least, by the law that
/// what a cell contributes falls by 2^-q: half of the cells of a grid where all contribute alike would be a waste.
std::vector<Index> economical_cells(const Vector& indicators, int q, Index most);

/// Cuts [0, T] into equal blocks, one for four cells, between the `breaks`, and each block into equal cells: `cells` in
/// all, as many in each as make Σ c n^-q least, where c n^-q is what a block of n cells contributes. `t` as it is where
/// all indicators are 0.
Vector divided(const Vector& t, const Vector& indicators, int q, Index cells, const std::vector<double>& breaks);

/// Halves the marked cells; those of a few roundings of T are left as they are.
Vector bisected(const Vector& t, const std::vector<Index>& marked);

struct AdaptedGrid {
  Vector t;
  GoalEvaluation last;
  std::vector<GoalCycle> history;
  Status status = Status::solved;
  std::string reason;
};

struct GridBounds {
  Index default_cells = 400;          ///< where neither cells, cycles nor a tolerance are asked for
  Index most_cells = Index(1) << 22;  ///< where the cells are not limited by Options
  std::vector<double> breaks;         ///< times that stay points
  bool memory_bound = false;          ///< most_cells is what fits the memory
};

/// Evaluates and refines until the cycles, cells or tolerance asked for. A grid that is blind is halved throughout, and
/// no tolerance is met on it.
AdaptedGrid adapt_grid(Vector t, const Options&, const GoalOptions&, const QuantityOfInterest&, const GridBounds&,
                       const std::function<GoalEvaluation(const Vector& t)>& evaluate);

}  // namespace bromwich

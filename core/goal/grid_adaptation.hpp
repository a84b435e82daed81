#pragma once
// The cycle of goal-oriented refinement, for any problem on the grids.

#include "../result/options.hpp"
#include "../result/result.hpp"
#include "options.hpp"

#include <functional>
#include <vector>

namespace bromwich {

/// `cells` equal cells on [0, T], with `breaks` (0 < t < T) among the points.
Vector first_grid(double T, Index cells, const std::vector<double>& breaks);

/// Doerfler marking: the fewest cells with the share `marking` of Σ |indicators|, at most `most`, in increasing order.
/// Empty if all indicators are 0.
std::vector<Index> marked_cells(const Vector& indicators, double marking, Index most);

/// The cells to halve: those with the largest |indicators|, as many as minimise M^q Σ |indicators| if halving reduces
/// the contribution of a cell by 2^-q. If all cells contribute equally, these are all cells.
std::vector<Index> economical_cells(const Vector& indicators, int q, Index most);

/// Divides [0, T] between the `breaks` into equal blocks, one per four cells, and each block into n equal cells,
/// `cells` in total. n minimises Σ c n^-q, where c n^-q is the contribution of a block of n cells. Returns `t` if all
/// indicators are 0.
Vector divided(const Vector& t, const Vector& indicators, int q, Index cells, const std::vector<double>& breaks);

/// Halves the marked cells, except those as short as a few roundings of T.
Vector bisected(const Vector& t, const std::vector<Index>& marked);

struct AdaptedGrid {
  Vector t;
  GoalEvaluation last;
  std::vector<GoalCycle> history;
  Status status = Status::solved;
  std::string reason;
};

struct GridBounds {
  Index default_cells = 400;          ///< if neither cells, cycles nor a tolerance are given
  Index most_cells = Index(1) << 22;  ///< if Options does not limit the cells
  std::vector<double> breaks;         ///< times that are points of every grid
  bool memory_bound = false;          ///< memory determines most_cells
};

/// Evaluates and refines up to the given cycles, cells or tolerance. On a blind grid all cells are halved, and no
/// tolerance is met.
AdaptedGrid adapt_grid(Vector t, const Options&, const GoalOptions&, const QuantityOfInterest&, const GridBounds&,
                       const std::function<GoalEvaluation(const Vector& t)>& evaluate);

}  // namespace bromwich

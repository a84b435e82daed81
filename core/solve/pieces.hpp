#pragma once
// Grids made of pieces: cell k of a uniform grid is divided into 2^{l_k} steps. Neighbouring cells with the same level
// are one piece, a scene of its own that begins with the state in which the one before ends. All pieces have steps of
// one geometric set, so that they share the phi-functions of hA (core/kernel/shared_dynamics.hpp).
//
// symbol  variable  meaning
// l       levels    one for each cell
// e_k     -         difference to the same grid with half the steps, at the end of cell k, relative to the goal

#include "../accuracy/convergence.hpp"
#include "stage.hpp"

#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// Whether a scene can be solved in pieces: dense dynamics with initial values, no free rows, M of class P, for which y
/// at the end of a piece and at the beginning of the next one are the same. Otherwise why not.
std::string unsuited_to_pieces(const Scene&);

/// By method march. Rows of the result are the ends of the cells; y is known at these alone, so `continuous` is false.
/// `y_integral` has the steps inside. Counts and seconds are sums, residual and rounding the largest of the pieces.
/// A piece that is not solved, or not with y linear between its points, ends it; its status and reason are those of the
/// result.
Result solve_in_pieces(const Scene&, Backend&, const InnerOptions&, const Solve&, const std::vector<int>& levels);

struct PieceGoal {
  double y = 0, x = 0;  ///< 0: not controlled
  ComponentSizes sizes;
  Index most_steps = 0;     ///< of a grid
  double most_seconds = 0;  ///< of all of them; 0: no limit
};

/// Divides cells where e_k is above a quarter until all e_k meet the goal, and halves all steps once more. The
/// difference has to fall by sqrt(2) at least, or be below a twentieth. With the observed order, 1 at most, it gives
/// the error. Empty where that is not reached.
std::optional<Result> refine_pieces(const Scene&, Backend&, const InnerOptions&, const Solve&, Index cells,
                                    const PieceGoal&);

}  // namespace bromwich

#pragma once
// Rows of a march over impacts beside another solution, whose impacts are at slightly other times: between the two a
// row has the velocity of the other side, however small the error of positions is.

#include "../result/result.hpp"

#include <functional>
#include <vector>

namespace bromwich {

struct RowOfSolution {
  Vector x, integral;  ///< of the recorded states, and of y over [0, t]
};

/// Where impacts are up to a step from a row, x (J+1 x recorded states) and the integral of y (J+1 x n) become those
/// with the impacts on that side of the row on which they are nearer to the other solution.
void take_sides(const std::vector<Impact>& impacts, const Vector& t, const std::vector<Index>& recorded,
                const std::function<RowOfSolution(Index row)>& other, RowMatrix& x, RowMatrix& integral);

}  // namespace bromwich

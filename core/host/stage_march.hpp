#pragma once

#include "../lcp/march_report.hpp"
#include "stage_problem.hpp"

namespace bromwich {

struct StageSolution {
  RowMatrix y;                 ///< (J+1) x n: y at the right ends of the steps
  RowMatrix impulse;           ///< (J+1) x n: integral of y over each step; row 0 is zero
  RowMatrix v;                 ///< (J+1) x n: N x_j
  RowMatrix x;                 ///< (J+1) x c: the requested components of x
  std::vector<Index> impacts;  ///< rows of steps with a new contact of a rigid position constraint
  MarchReport report;
  std::size_t bytes = 0;  ///< of the factorizations
};

/// `y0` is y_0, or NaN if it is unknown; row 0 of y is then the value at the first stage. Rows from `report.stopped` on
/// are NaN. Throws Error if the matrix of a step is singular.
StageSolution march_by_stages(const StageProblem&, const Vector& y0);

}  // namespace bromwich

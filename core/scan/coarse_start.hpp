#pragma once
// First states between chunks of time: those of a march of few steps of implicit Euler, with the sources at some of the
// time points.

#include "../host/stage_problem.hpp"
#include "chunk_scan.hpp"

namespace bromwich {

/// A scene with its sources at the rows of a fine march.
struct CoarseInput {
  const Dynamics* dynamics = nullptr;
  const LcpMatrix* M = nullptr;
  LcpClass lcp_class = LcpClass::unknown;
  SparseMatrix F;
  Vector x0;
  Vector t;          ///< of the rows
  RowMatrix g, phi;  ///< phi is empty without f
};

struct CoarseStates {
  std::vector<Vector> x, y;  ///< m and n, for each chunk
};

/// At the first rows of the chunks. x0 and zero where the plan asks for no coarse start, or where it has no solution.
CoarseStates coarse_states(const ScanPlan&, const std::vector<Index>& rows, const std::function<CoarseInput()>& input,
                           const Vector& x0, Index constraints);

}  // namespace bromwich

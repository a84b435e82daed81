#pragma once

#include "../base/types.hpp"
#include "bromwich/result.hpp"

namespace bromwich {

/// The outcome of the complementarity problems of a step-by-step solution.
struct MarchReport {
  LcpCount count;
  Index infeasible = -1;   ///< row at which no solution exists, or -1; rows from there on are NaN
  Index stopped = -1;      ///< row at which a problem stayed unsolved or not finite, or -1; rows from there on are NaN
  bool well_posed = true;  ///< the class of the scene or of the matrix of a step determines its solution
  Index jumps = 0;         ///< steps of `march_by_stages` that were taken by implicit Euler
  bool interrupted = false;
  bool finite = true;
  double lcp_seconds = 0;
};

}  // namespace bromwich

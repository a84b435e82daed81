#pragma once

#include "discrete_problem.hpp"
#include "solve.hpp"

namespace bromwich {

/// Steps the state with y discontinuous from step to step (StageProblem in core/backend.hpp): two stages (Radau IIA) or
/// one (implicit Euler). Fills status, y, x (the components of the problem), counters, residual and seconds. A
/// Kronecker sum is written out as sparse matrices.
void solve_by_stages(const DiscreteProblem&, Index stages, const Options&, Result& result);

}  // namespace bromwich

#pragma once

#include "../kernel/discrete_problem.hpp"
#include "../result/inner_options.hpp"
#include "../result/result.hpp"

namespace bromwich {

/// Steps the state with y discontinuous from step to step (core/host/stage_problem.hpp): two stages (Radau
/// IIA) or one (implicit Euler). Fills status, y, x (the components of the problem), counters, residual and seconds. A
/// Kronecker sum is written out as sparse matrices.
void solve_by_stages(const DiscreteProblem&, Index stages, const InnerOptions&, Result& result);

}  // namespace bromwich

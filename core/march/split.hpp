#pragma once
// March of dense scenes with continuous y by core/march/split_steps.hpp, on the host: those whose sources are rough on
// some steps, and all of them by Newton's method on the states between chunks of time (core/scan/chunk_scan.hpp). Other
// steps are those of the usual march. A chunk needs x and y of the last step before it.

#include "../kernel/discrete_problem.hpp"
#include "../result/options.hpp"
#include "../result/result.hpp"
#include "../scan/chunk_scan.hpp"

namespace bromwich {

/// Exponential rule, dense dynamics. Fills the result as the usual march does, and where steps are in parts the
/// requested components of the state and Result::defects. `plan`: by chunks; null: step by step.
void solve_by_split_marching(const DiscreteProblem&, const Options&, Result& result, const ScanPlan* plan = nullptr);

}  // namespace bromwich

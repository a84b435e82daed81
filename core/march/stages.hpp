#pragma once

#include "../host/stage_problem.hpp"
#include "../kernel/discrete_problem.hpp"
#include "../result/inner_options.hpp"
#include "../result/result.hpp"
#include "../scan/chunk_scan.hpp"

namespace bromwich {

/// Marches the state with y discontinuous between steps (core/host/stage_problem.hpp): two stages (Radau IIA) or one
/// (implicit Euler). Fills status, y, x (the requested components), counters, residual and seconds. A Kronecker sum is
/// stepped in sine modes; with an f that does not enter through B it is converted to sparse
/// matrices. `poles`: the dynamics by few poles, stepped instead of the state where all steps have one length.
/// `plan`: dense dynamics by chunks of time (core/scan/stage_chunks.hpp); null: step by step.
void solve_by_stages(const DiscreteProblem&, Index stages, const InnerOptions&, Result& result,
                     std::shared_ptr<const PoleModel> poles = nullptr, const ScanPlan* plan = nullptr);

/// The problem of two stages for dense dynamics on steps of one length. It refers to the scene. Precondition: no rough
/// steps.
StageProblem smooth_stage_problem(const DiscreteProblem&);

}  // namespace bromwich

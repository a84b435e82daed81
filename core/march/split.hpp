#pragma once
// March of dense scenes with continuous y whose sources are rough on some steps (core/scene/source_steps.hpp). These
// steps are divided into parts. On a part of length d, with y linear and f piecewise polynomial,
//
//     x(t + d) = e^{dA} x + ∫_0^d e^{(d-s)A} (B y + f) ds,    0 <= y(t + d) ⊥ N x(t + d) + M y(t + d) + g >= 0,
//
// and after a jump of g, y starts anew from SOL(M, N x + g(t+)). Other steps are those of the usual march. Runs on the
// host only, with one matrix per length of part.

#include "../kernel/discrete_problem.hpp"
#include "../result/options.hpp"
#include "../result/result.hpp"

namespace bromwich {

/// Exponential rule, dense dynamics. Fills the result as the usual march does, plus the requested components of the
/// state and Result::defects.
void solve_by_split_marching(const DiscreteProblem&, const Options&, Result& result);

}  // namespace bromwich

#pragma once
// The march of dense scenes with continuous y where sources are rough on some steps (core/scene/source_steps.hpp):
// those steps are taken in parts. On a part of length d, with y linear and f in its pieces,
//
//     x(t + d) = e^{dA} x + ∫_0^d e^{(d-s)A} (B y + f) ds,    0 <= y(t + d) ⊥ N x(t + d) + M y(t + d) + g >= 0,
//
// and where g jumps y starts anew from SOL(M, N x + g(t+)). Steps that are not rough are those of the other march.
// The host alone: the matrix of a part is that of its length.

#include "../kernel/discrete_problem.hpp"
#include "../result/options.hpp"
#include "../result/result.hpp"

namespace bromwich {

/// Exponential rule, dense dynamics. Fills what solve_by_marching does, the components of the state that the problem
/// asks for, and Result::defects.
void solve_by_split_marching(const DiscreteProblem&, const Options&, Result& result);

}  // namespace bromwich

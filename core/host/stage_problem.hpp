#pragma once

#include "../dynamics/dynamics.hpp"
#include "../lcp/matrix.hpp"

#include <functional>
#include <vector>

namespace bromwich {

/// y discontinuous from one step to the next, for M that leaves y to the dynamics (M = 0 in the extreme).
///
/// Two stages: the Radau IIA method with nodes c = 1/3, 1, complementarity at both,
///     X_i = x_{j-1} + h Σ_k a_ik (A X_k + B y_k + f_k),   0 <= y_i ⊥ N X_i + M y_i + g_i >= 0,   x_j = X_2,
/// one complex shifted solve a step, since the inverse of (a_ik) has eigenvalues 2 ± i sqrt(2). It is stiffly accurate,
/// so that y has no memory of its own, and algebraically stable, so that passive scenes stay passive. A step in which
/// the state jumps is taken by implicit Euler instead, which puts x_j on the constraint at once; so are
/// all steps where the problem of two stages is neither P nor PSD and that of one stage is. One stage: implicit Euler
/// throughout.
struct StageProblem {
  const Dynamics* dynamics = nullptr;  ///< dense, sparse or supplied
  const LcpMatrix* M = nullptr;
  LcpClass lcp_class = LcpClass::unknown;
  Index stages = 2;               ///< 2 or 1
  double h = 0;                   ///< step
  std::vector<double> lengths;    ///< of the step to row j, at j - 1; empty: all are h
  Vector x0;                      ///< m
  RowMatrix g;                    ///< (J+1) x (stages n): row j holds g at the stages of the step to t_j; row 0 is g(0)
  RowMatrix phi;                  ///< (J+1) x (stages k): the same of phi with f = F phi; or empty
  SparseMatrix F;                 ///< m x k
  std::vector<Index> components;  ///< of the state, to be recorded
  std::function<bool()> interrupted;         ///< polled now and then; true ends the march
  std::function<void(Index step)> progress;  ///< called now and then
};

}  // namespace bromwich

#pragma once

#include "../dynamics/dynamics.hpp"
#include "../lcp/matrix.hpp"
#include "../numerics/face_basis.hpp"
#include "pole_model.hpp"

#include <functional>
#include <memory>
#include <vector>

namespace bromwich {

/// A Kronecker sum in sine modes, with one state for each rate of each mode:
///     z_kl' = (s_k + mu_l) z_kl + i_k S (y + phi),   S N x = Σ_k o_k z_kl.
/// Rates are the eigenvalues of a line, and z the state in modes, or fewer ones that represent the transfer function of
/// a line (core/kernel/transfer_fit.hpp); the state is not known then.
struct ModalStages {
  FaceBasis face;        ///< V
  Vector along;          ///< n: mu
  Vector rates;          ///< K: s
  Vector input, output;  ///< K: i, o
  RowMatrix start;       ///< K x n: z(0)
  Matrix across;         ///< K x K: the modes of a line in its columns; only where states are recorded
  double direct = 0;     ///< n^T b of a line: N B = direct I
  bool has_state = true;
};

/// A march with y discontinuous between steps, for M that leaves y to the dynamics (M = 0 in the extreme).
///
/// Two stages: Radau IIA with nodes c = 1/3, 1 and complementarity at both,
///     X_i = x_{j-1} + h Σ_k a_ik (A X_k + B y_k + f_k),   0 <= y_i ⊥ N X_i + M y_i + g_i >= 0,   x_j = X_2.
/// One complex shifted solve per step suffices, since (a_ik)^{-1} has the eigenvalues 2 ± i sqrt(2). The method is
/// stiffly accurate, so y has no memory, and algebraically stable, so passive scenes stay passive. A step in which the
/// state jumps is taken by implicit Euler, which puts x_j on the constraint at once. So are all steps if the two-stage
/// problem is neither P nor PSD and the one-stage problem is. One stage: implicit Euler throughout.
struct StageProblem {
  const Dynamics* dynamics = nullptr;             ///< dense, sparse or supplied, or a Kronecker sum with `modal`
  std::shared_ptr<const ModalStages> modal = {};  ///< phi enters through B then
  const LcpMatrix* M = nullptr;
  LcpClass lcp_class = LcpClass::unknown;
  Index stages = 2;               ///< 2 or 1
  double h = 0;                   ///< step
  std::vector<double> lengths;    ///< length of the step to row j at index j - 1; empty: all are h
  Vector x0;                      ///< m
  RowMatrix g;                    ///< (J+1) x (stages n): row j holds g at the stages of the step to t_j; row 0 is g(0)
  RowMatrix phi;                  ///< (J+1) x (stages k): the same for phi, f = F phi; may be empty
  SparseMatrix F;                 ///< m x k
  std::vector<Index> components;  ///< state components to record
  bool substitutes_euler = true;  ///< steps in which the state jumps are taken by implicit Euler
  bool jumps_at_start = false;    ///< x0 violates the constraints
  std::function<bool()> interrupted;            ///< polled from time to time; true ends the march
  std::function<void(Index step)> progress;     ///< called from time to time
  std::shared_ptr<const PoleModel> poles = {};  ///< instead of the state of the dynamics
};

}  // namespace bromwich

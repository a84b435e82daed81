#pragma once
// One step of the state with s stages, y given:
//
//     X_i = x + h Σ_k a_ik (A X_k + B y_k + F phi_k),   i = 1..s,   x_j = X_s.
//
// With L = (a_ik)^{-1} this is (L/h ⊗ I - I ⊗ A) X = (L 1)/h ⊗ x + (B y_k + F phi_k)_k. For Radau IIA (s = 2), L has
// the eigenvalues mu = 2 ± i sqrt(2), so one complex shifted solve gives both stages:
//
//     (mu/h I - A) xi = (w · L1)/h x + Σ_k w_k (B y_k + F phi_k),   X_i = 2 Re(v_i xi),
//
// with the eigenvector v and the row w of the inverse eigenvector matrix. Implicit Euler (s = 1): mu = v = w = 1, no 2
// Re. (Hairer, Wanner, Solving Ordinary Differential Equations II, section IV.8.)

#include "stage_problem.hpp"

#include <memory>
#include <vector>

namespace bromwich::host {

/// The step of dense dynamics as matrices: q = see x + (row of) q, x_free = decay x + forcing, and y by drive and
/// implicit.
struct DenseStageMaps {
  Matrix decay, see, drive, implicit;  ///< m x m, s n x m, m x s n, s n x s n
  Matrix push, seen_push;              ///< m x s k and s n x s k, of phi at the stages; empty without F
  RowMatrix q, forcing;                ///< rows x s n and x m; forcing is empty without f
};

class StageStep {
 public:
  virtual ~StageStep() = default;

  /// The step without y: q (s n) = N X_i + g_i for all stages, x_free (m) = X_s. `j` is the index in `rows`.
  virtual void free(const Vector& x, Index j, Vector& q, Vector& x_free) = 0;
  /// Adds the contribution of y (s n, all stages) to x_free.
  virtual void drive(const Vector& y, Vector& x_free) const = 0;
  /// s n x s n: derivative of N X_i with respect to y_k.
  virtual const Matrix& implicit_part() const = 0;
  /// Of dense dynamics; null otherwise.
  virtual const DenseStageMaps* maps() const { return nullptr; }
  virtual std::size_t bytes() const = 0;
};

/// Steps of length h to these rows of the problem, with 2 or 1 stages, whatever the problem says. With 1, the last
/// stage values of g and phi are used. Throws Error if the matrix of a step is singular.
std::unique_ptr<StageStep> make_stage_step(const StageProblem&, Index stages, double h, const std::vector<Index>& rows);

/// The same for a Kronecker sum in sine modes; the state is that of ModalStages.
std::unique_ptr<StageStep> make_modal_stage_step(const StageProblem&, Index stages, double h,
                                                 const std::vector<Index>& rows);

/// The same for a model of few poles; the state is that of PoleModel.
std::unique_ptr<StageStep> make_pole_stage_step(const StageProblem&, Index stages, double h,
                                                const std::vector<Index>& rows);

DenseStageMaps dense_stage_maps(const StageProblem&, const DenseDynamics&, Index stages, double h,
                                const std::vector<Index>& rows);

/// Stage values of g or phi for a step with `used` stages: the last `used` of `given`, for these rows.
RowMatrix last_stages(const RowMatrix& values, Index given, Index used, const std::vector<Index>& rows);

}  // namespace bromwich::host

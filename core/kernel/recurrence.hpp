#pragma once
// Recurrences (core/seam/recurrence.hpp) of dynamics.

#include "../dynamics/dynamics.hpp"
#include "../numerics/matrix_phi.hpp"
#include "../seam/recurrence.hpp"

namespace bromwich {

/// The integrator behind the weights.
enum class Rule {
  exponential,     ///< exact for piecewise linear y: W_0 = h N phi2 B, W_d = h N e^{(d-1)hA} phi1^2 B
  implicit_euler,  ///< (1.3)-(1.4): W_d = h N (I - hA)^{-(d+1)} B; y_0 has no effect
};

/// One exponential for each of the `across.points` eigenvalues of the lines. `x0_modal` is x0 transformed in both
/// directions (n x across.points), or empty to omit x0. Throws Error if x0 is given and a sine component of b vanishes.
ModalRecurrence modal_recurrence(const KroneckerDynamics&, Rule, double h, const RowMatrix& x0_modal);

/// `initial` of the recurrence with all eigenvalues: v_1 contains e^x x0 = output * initial, x = h times the
/// eigenvalue. Throws Error if a sine component of b vanishes.
RowMatrix modal_start(const ModalRecurrence&, const KroneckerDynamics&, Rule, double h, const RowMatrix& x0_modal);

/// One step of x' = A x + u: x_j = decay x_{j-1} + left u_{j-1} + right u_j, m x m each. Exponential: u is linear
/// between the points; implicit Euler: left = 0.
struct StepOperators {
  Matrix decay, left, right;
};

/// Whether the rounding error of e^{hA} in double precision, eps h ||A|| in balanced units, exceeds 1e-9 over J steps
/// and A is small enough for the precise computation (core/numerics/precise_phi.hpp).
bool needs_precision(const Matrix& A, double h, Index J);

/// Whether I - hA is nonsingular.
bool has_euler_step(const Matrix& A, double h);

/// e^{hA} and its phi-functions (core/numerics/phi.hpp; in higher precision if J steps need it), or (I - hA)^{-1} by LU
/// factorization. Throws Error if I - hA is singular.
StepOperators step_operators(const Matrix& A, Rule, double h, Index J = 1);

/// The exponential one from the phi-functions of hA.
StepOperators exponential_step(const MatrixPhi&, double h);

/// z_j = decay x_j + left B y_j, the part of x_{j+1} known after step j.
DenseRecurrence dense_recurrence(const DenseDynamics&, const StepOperators&);
DenseRecurrence dense_recurrence(const DenseDynamics&, Rule, double h);

/// W_d and S_d, d = 0..J, of the recurrence.
LagTable lag_table(const Recurrence&, Index J);

}  // namespace bromwich

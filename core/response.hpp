#pragma once
// The part of w that does not depend on y: r(t) = N e^{At} x0 + ∫_0^t N e^{A(t-s)} f(s) ds + g(t), and x itself.

#include "backend.hpp"
#include "separable.hpp"

namespace bromwich {

struct StepDefects;  // core/discrete_problem.hpp

/// t_j = j T/J, j = 0..J.
Vector time_grid(double T, Index J);

/// S_ik = sqrt(2/(n+1)) sin(pi i k/(n+1)), n x n: symmetric, orthonormal.
Matrix sine_matrix(Index n);

/// S v by a sum over the nonzero entries of v, which are few in the b and n of a line.
Vector in_sine_basis(const Vector& v);

/// Every row in the sine basis.
RowMatrix row_modes(Backend&, const RowMatrix& rows);

/// x0 with only the `along` direction (`both` = false) or both directions in the sine basis: n x across.points.
RowMatrix x0_in_modes(Backend&, const KroneckerDynamics&, const Vector& x0, bool both);

/// x_j of x' = A x + u with u piecewise linear on the grid (exponential) or sampled at the right ends (Euler), for
/// given inputs u_j = B y_j + f_j in R^m and what single steps add: (J+1) x m, row 0 = x0.
RowMatrix dense_states(const StepOperators&, const Vector& x0, const RowMatrix& u, const StepDefects* = nullptr);
RowMatrix dense_states(const Matrix& A, Rule, double h, const Vector& x0, const RowMatrix& u);

}  // namespace bromwich

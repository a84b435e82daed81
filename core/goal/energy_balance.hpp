#pragma once
// The energy balance of a trajectory of a port-Hamiltonian system, step by step:
//
//     v_i = ∫_{I_i} (x^T Q^T R Q x - u^T B^T Q x) dt + H(x_i) - H(x_{i-1}),
//
// This violation is 0 for the exact solution. x between the time points and the quadrature are those of the scheme
// (core/goal/reconstruction.hpp). Implicit Euler: v_i = -||x_i - x_{i-1}||^2 / 2 in the norm of Q^T E; implicit
// midpoint with u constant: v_i = h/12 ||x_i - x_{i-1}||^2 in that of Q^T R Q.

#include "bromwich/goal.hpp"
#include "reconstruction.hpp"

namespace bromwich {

EnergyBalance energy_balance(const Trajectory&);

/// With constraints: `y` ((M+1) x n) at the time points, and `port_matrix` (m x n, Q^T E B).
PowerBalance power_balance(const Trajectory&, const RowMatrix& y = {}, const RowMatrix& port_matrix = {});

/// Σ_i weights_i dv_i/dx: (M+1) x m. One weight per step.
RowMatrix balance_gradient(const Trajectory&, const Vector& weights);

}  // namespace bromwich

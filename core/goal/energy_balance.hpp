#pragma once
// The energy balance of a trajectory of a port-Hamiltonian system, step by step:
//
//     v_i = ∫_{I_i} (x^T Q^T R Q x - u^T B^T Q x) dt + H(x_i) - H(x_{i-1}),
//
// This violation is 0 for the exact solution. x between the time points and the quadrature are those of the scheme
// (core/goal/reconstruction.hpp). Implicit Euler: v_i = -||x_i - x_{i-1}||^2 / 2 in the norm of Q^T E; implicit
// midpoint with u constant: v_i = h/12 ||x_i - x_{i-1}||^2 in that of Q^T R Q.

#include "reconstruction.hpp"

namespace bromwich {

struct EnergyBalance {
  Vector energy;      ///< M+1: H(x_i)
  Vector supplied;    ///< M: through the ports during the step, ∫ u^T B^T Q x
  Vector dissipated;  ///< M: during the step
  Vector violation;   ///< M: dissipated - supplied + change of energy
};

EnergyBalance energy_balance(const Trajectory&);

/// Both terms of dH/dt = supplied - dissipated at the time points, with the left limit of u (at t = 0 the right limit).
struct PowerBalance {
  Vector supplied;    ///< M+1: u^T B^T Q x, and y^T B^T Q^T E x of constraints
  Vector dissipated;  ///< M+1: x^T Q^T R Q x
};

/// With constraints: `y` ((M+1) x n) at the time points, and `port_matrix` (m x n, Q^T E B).
PowerBalance power_balance(const Trajectory&, const RowMatrix& y = {}, const RowMatrix& port_matrix = {});

/// Σ_i weights_i dv_i/dx: (M+1) x m. One weight per step.
RowMatrix balance_gradient(const Trajectory&, const Vector& weights);

}  // namespace bromwich

#pragma once
// Linear port-Hamiltonian systems:
//
//     E x' = (J - R) Q x + B u(t),   output B^T Q x,   energy H(x) = x^T Q^T E x / 2,
//     dH/dt = u^T B^T Q x - (Q x)^T R (Q x):  power supplied by the ports minus dissipation.
//
// symbol  variable              shape   meaning
// E       PortHamiltonian::E    m x m   descriptor matrix, regular; empty = identity
// J, R    PortHamiltonian::J,R  m x m   structure (skew) and dissipation (symmetric, positive semidefinite)
// Q       PortHamiltonian::Q    m x m   energy, Q^T E symmetric and positive semidefinite; empty = identity
// B, u    PortHamiltonian::B,u  m x k   ports and their input

#include "../base/time_function.hpp"
#include "scene.hpp"

#include <vector>

namespace bromwich {

struct PortHamiltonian {
  SparseMatrix E, J, R, Q, B;
  TimeFunction u;             ///< k values; empty = 0
  std::vector<double> jumps;  ///< times where u is known to jump; others are searched (input_jumps)

  Index states() const { return J.rows(); }
  Index ports() const { return B.cols(); }

  /// Throws Error naming the first member that breaks the structure: sizes, J + J^T = 0, R and Q^T E symmetric and
  /// positive semidefinite (to rounding, whatever the units of the rows), E regular. For a singular E it describes the
  /// system (describe_singular).
  void validate() const;

  SparseMatrix state_matrix() const;        ///< (J - R) Q
  SparseMatrix energy_matrix() const;       ///< Q^T E
  SparseMatrix dissipation_matrix() const;  ///< Q^T R Q
  SparseMatrix output_matrix() const;       ///< Q^T B; outputs are its transpose times x
  double energy(const Vector& x) const;     ///< H(x)
};

/// The system without complementarity as a scene: A = E^{-1} (J - R) Q, f = E^{-1} B u; dense up to 256 states,
/// Scene::port set, no constraints. Validates the structure.
Scene make_scene(PortHamiltonian port, const Vector& x0, double T);

/// A scene without constraints with one that never acts, 0 <= y ⊥ y >= 0.
Scene with_idle_constraint(Scene);

/// A and E^{-1} B, as make_scene writes them. E must be regular. Throws Error where E is not diagonal and A has more
/// than 5e7 entries.
struct StateSpace {
  SparseMatrix A, F;
};
StateSpace state_space(const PortHamiltonian&);

/// The limit at a time from the left or from the right.
enum class Side { before, behind };

/// Times in (0, T) where u jumps: those given, and those found by halving the intervals of `samples` in which u changes
/// more than twice as much as beside them. Two jumps between three samples are not seen, nor one smaller than what u
/// changes otherwise.
std::vector<double> input_jumps(const PortHamiltonian&, double T, Index samples = 1000);

}  // namespace bromwich

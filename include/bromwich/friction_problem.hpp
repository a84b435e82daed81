#pragma once
// Contact problems with Coulomb's friction on circles, without dynamics: a step of a simulation in space. With
//
//     u = W r + q,   of each contact 0 <= r_n ⊥ u_n >= 0,  |r_t| <= mu r_n,  r_t = -mu r_n u_t / |u_t| where u_t != 0.
//
// symbol  shape    meaning
// W       3k x 3k  Delassus operator, as a rule positive semidefinite; of each of k contacts the normal, then two
// tangents q       3k       velocities without forces, shifted by restitution mu      k        coefficients of friction
// r, u    3k       forces (or impulses), velocities

#include "lcp_batch.hpp"
#include "types.hpp"

namespace bromwich {

struct FrictionOptions {
  double tolerance = 1e-10;  ///< of the residual
  Index most_sweeps = 20000;
};

struct FrictionResult {
  Vector r, u;
  LcpStatus status = LcpStatus::unsolved;  ///< solved, unsolved or nonfinite
  /// The largest |F_i| / max_j(|r_j|, rho_j |q_j|) with r - F the projection of r - rho u, forces in the units in which
  /// the diagonal of W is 1: onto r_n >= 0, then onto |r_t| <= mu r_n (Alart & Curnier, Comput. Methods Appl. Mech.
  /// Engrg. 92, 1991).
  double residual = 0;
  Index newton = 0, sweeps = 0;  ///< linear systems solved, and sweeps over all contacts
};

/// By sweeps of exact solves of each contact (nonsmooth Gauss-Seidel) and semismooth Newton between them. Where
/// `solved`, r is one solution: there may be others, as where contacts share a load, or none. Throws Error where shapes
/// do not fit or mu is negative.
FrictionResult solve_friction(const Matrix& W, const Vector& q, const Vector& mu, const FrictionOptions& = {});

}  // namespace bromwich

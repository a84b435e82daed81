#pragma once
// Whether the boundary condition of a scene determines its states, and whether its solution is unique.

#include "discretisation.hpp"

#include <string>

namespace bromwich {

/// Throws Error if the rows of [E0 ET] are dependent: more than m conditions, or fewer, whatever the dynamics.
void require_independent_rows(const BoundaryCondition&);

/// Throws Error: E0 + ET e^{TA} is singular.
[[noreturn]] void refuse_open_mode(double reciprocal_condition);

/// The reciprocal condition of x' = A x with the boundary condition (core/numerics/two_point.hpp), which is that of E0
/// + ET e^{TA} without its overflow. Throws Error if it is singular, or if the rows of [E0 ET] are dependent.
double require_determined_states(const GalerkinProblem&);

struct Uniqueness {
  bool assured = false;
  double eigenvalue = NAN;  ///< the smallest of the symmetric part if it is not; NaN: not looked at
};

/// Strong monotonicity (core/galerkin/uniqueness.hpp) with some weights, tested on a coarse grid. It does not assure
/// initial values whose intervals are not of class P.
Uniqueness uniqueness_of(const Scene&, Index N);

}  // namespace bromwich

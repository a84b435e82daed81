#pragma once
// What can be said of a scene before and beside its solution: whether its boundary condition determines the states, and
// whether its solution is the only one.

#include "discretisation.hpp"

#include <string>

namespace bromwich {

/// The reciprocal condition of x' = A x with the boundary condition (core/numerics/two_point.hpp), which is that of E0
/// + ET e^{TA} without its overflow. Throws Error where it is singular, or where the rows of [E0 ET] are dependent.
double require_determined_states(const GalerkinProblem&);

struct Uniqueness {
  bool assured = false;
  std::string words;  ///< one line where it is not
};

/// Strong monotonicity (core/galerkin/uniqueness.hpp) with some weights, looked at on a coarse grid; initial values
/// whose intervals are not of class P are not assured by that.
Uniqueness uniqueness_of(const Scene&, Index N);

}  // namespace bromwich

#pragma once
// Derivatives of a quantity of interest (core/goal/quantities.hpp) with respect to the data of a scene: the quantity of
// the discrete states, x a line between the time points,
//
//     I = ∫ j(t, x) dt + e(x(T)),   dI = Σ_i x̄_i · dx_i,
//
// whose weights x̄ go into the vjp of a derivative. With an open end at a switch (one-sided rows) they are refused
// there.

#include "../core/goal/quantities.hpp"
#include "solution_derivative.hpp"

namespace bromwich {

struct QuantityChange {
  double value = 0;        ///< I of the discrete states
  SolutionChange weights;  ///< x̄ alone: (J+1) x m
};

/// `x`: the states at the times t, all of them. Throws Error for a quantity of the energy balance where the scene is
/// not port-Hamiltonian, and for tables of another shape.
QuantityChange quantity_change(const QuantityOfInterest&, const Scene&, const Vector& t, const RowMatrix& x);

}  // namespace bromwich

#pragma once
// Polynomials of degree `degree` on [0, 1] by their Legendre coefficients, and Radau IIA with that many stages as a
// collocation method: order 19, L-stable, with a polynomial on the whole step.
//
// symbol  variable     meaning
// c       nodes        0 and the Radau points, the last is 1
// A       runge_kutta  integrals of the Lagrange polynomials of the Radau points
// P_k     legendre     shifted Legendre polynomials; a polynomial is a (degree+1) x components matrix

#include "core/base/types.hpp"

namespace bromwich::oracle {

struct Collocation {
  static constexpr Index degree = 10;

  Vector nodes;         ///< degree + 1: 0, then the Radau points
  Matrix runge_kutta;   ///< degree x degree
  Matrix values;        ///< from coefficients to values at the nodes
  Matrix coefficients;  ///< the inverse
  Vector samples;       ///< degree + 1 Chebyshev points inside (0, 1), so that sources are not sampled at jumps
  Matrix from_samples;  ///< from values at the samples to coefficients
  Matrix derivative;    ///< from coefficients to those of the derivative

  static const Collocation& get();
};

/// P_0(s), ..., P_last(s).
Vector legendre(double s, Index last = Collocation::degree);
/// The integrals of P_0, ..., P_degree over [0, s].
Vector legendre_integrals(double s);

}  // namespace bromwich::oracle

#pragma once
// Legendre polynomials shifted to [0, 1], and their integrals.

#include "../base/types.hpp"

namespace bromwich {

/// s: of the polynomials between located switches.
inline constexpr Index legendre_degree = 7;

/// P_0(at), ..., P_s(at).
Vector legendre(double at);
/// The integrals of P_0, ..., P_s over [0, at].
Vector legendre_integrals(double at);

/// Both at many places, one row each: places x (s+1).
Matrix legendre_rows(const Vector& at);
Matrix legendre_integral_rows(const Vector& at);

}  // namespace bromwich

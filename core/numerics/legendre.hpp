#pragma once
// Legendre polynomials shifted to [0, 1], and their integrals.

#include "../base/types.hpp"

namespace bromwich {

/// s: of the polynomials between located switches.
inline constexpr Index legendre_degree = 7;

using LegendreValues = Eigen::Matrix<double, legendre_degree + 1, 1>;
/// (s+1) x components: a polynomial with several components.
using LegendreCoefficients = Eigen::Matrix<double, legendre_degree + 1, Eigen::Dynamic>;

/// P_0(at), ..., P_s(at).
LegendreValues legendre(double at);
/// The integrals of P_0, ..., P_s over [0, at].
LegendreValues legendre_integrals(double at);

/// Both at many places, one row each: places x (s+1).
Matrix legendre_rows(const Vector& at);
Matrix legendre_integral_rows(const Vector& at);

}  // namespace bromwich

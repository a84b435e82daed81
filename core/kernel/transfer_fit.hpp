#pragma once
// Functions of z as sums of few poles, for methods that see e^{At} only through a rational rule.
//
// A one-step rule (convolution quadrature) evaluates the transfer function F(z) of a convolution at the eigenvalues of
// Delta(zeta)/h, |zeta| <= 1. For implicit Euler this is (1 - zeta)/h; for Radau IIA with two stages, the roots of
// (hz)^2 - (4 + 2 zeta) hz + 6 (1 - zeta) = 0. For mode l of a Kronecker sum F_l(z) = G(z - mu_l). All these z - mu_l
// lie in a bounded part of the right half-plane, where
//
//     G(z) ≈ Σ_k c_k / (z - s_k) + b + a z,     s_k <= 0 real.
//
// Rates are picked from a logarithmic grid by a column-pivoted QR, coefficients are a least-squares fit, and the error
// is measured at points between the samples. The error at any z of the region bounds that of every weight.

#include "../dynamics/kronecker.hpp"

#include <functional>

namespace bromwich {

struct PoleSum {
  Vector rates;             ///< K, s_k in 1/time
  Matrix coefficients;      ///< K x f, one column for each function
  Vector constant, linear;  ///< f: b and a; zero for functions that decay
  double error = 0;         ///< largest error at the check points, relative to |G(z)| there

  Index functions() const { return coefficients.cols(); }
};

/// Where a rule on steps h up to T evaluates the transfer functions of modes with these mu <= 0.
struct FitRegion {
  bool radau = false;  ///< two stages; otherwise implicit Euler
  double h = 0, T = 0;
  double slowest_shift = 0, fastest_shift = 0;  ///< smallest and largest -mu
  double density = 1;                           ///< of the points: lower where a value costs much
};

/// f values at z.
using TransferFunctions = std::function<ComplexVector(Complex z)>;

/// Rates from -slowest to -fastest. With `grows`, b and a are fitted too. The number of rates grows until `tolerance`
/// is met; a larger fit is taken only where it is better.
PoleSum fit_poles(const TransferFunctions&, Index functions, const FitRegion&, double slowest, double fastest,
                  bool grows, double tolerance = 1e-13);

/// The transfer function of a grid line, of each family, by few poles with rates in its spectrum, for steps h up to T.
PoleSum fit_line(const KroneckerDynamics&, bool radau, double h, double T);

inline constexpr double accepted_fit_error = 1e-10;  ///< up to which a fit may replace exact values

}  // namespace bromwich

#pragma once
// Whether the functional iteration will converge, known before it runs.
//
// With L the Lipschitz constant of SOL(M, .), or entry by entry |SOL(q) - SOL(q')| <= <M>^{-1} |q - q'| for H+
// matrices,
//
//     kappa_d = || <M>^{-1} |W_d| ||_inf   (H+),   L ||W_d||_inf   (otherwise),
//     |y^{k+1} - y^k|_j <= Σ_d kappa_d |y^k - y^{k-1}|_{j-d},   khat(s) = Σ_d kappa_d e^{-s t_d}.
//
// In the norm max_j e^{-s t_j} |y_j| a sweep contracts by khat(s), so that an error of size one is below tol everywhere
// on [0,T] after (s T + ln 1/tol) / -ln khat(s) sweeps, for every s with khat(s) < 1. kappa_0 < 1 is needed for any.
// With khat(s1) = 1, errors may first grow by e^{s1 T}: rounding included.

#include "../kernel/discrete_problem.hpp"
#include "../kernel/recurrence.hpp"

namespace bromwich {

struct Forecast {
  double lipschitz = 0;    ///< L, infinite where SOL(M, .) is not Lipschitz as far as is known
  double kappa0 = 0;       ///< of the lag that a sweep cannot see through
  double growth_rate = 0;  ///< s1, 1/time; 0 where khat(0) < 1 already
  double sweeps = 0;       ///< bound of the number of sweeps to the tolerance; infinite where none is known

  /// The iteration may be relied on: kappa_0 < 1/2, and what rounding grows to stays below the tolerance.
  bool converges(double T, double tolerance) const;
  /// The longest horizon on which rounding, grown by e^{s1 T}, stays below the tolerance; infinite where it never
  /// grows.
  double longest_window(double tolerance) const;
};

/// kappa_0 alone, from |W_0| 1; infinite where M is neither H+ nor, as a P-matrix, has a known L.
double instant_contraction(const LcpMatrix& M, LcpClass, const Vector& row_sums);

Forecast forecast(const LcpMatrix& M, const LagTable&, double h, double tolerance);

}  // namespace bromwich

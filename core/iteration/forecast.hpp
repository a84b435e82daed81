#pragma once
// A-priori bound of the convergence of the functional iteration.
//
// With L the Lipschitz constant of SOL(M, .), or entry by entry |SOL(q) - SOL(q')| <= <M>^{-1} |q - q'| for H+
// matrices,
//
//     kappa_d = || <M>^{-1} |W_d| ||_inf   (H+),   L ||W_d||_inf   (otherwise),
//     |y^{k+1} - y^k|_j <= Σ_d kappa_d |y^k - y^{k-1}|_{j-d},   khat(s) = Σ_d kappa_d e^{-s t_d}.
//
// In the norm max_j e^{-s t_j} |y_j| a sweep contracts by khat(s). So for every s with khat(s) < 1, an error of size
// one is below tol everywhere on [0,T] after (s T + ln 1/tol) / -ln khat(s) sweeps. Such an s exists only if kappa_0 <
// 1. With khat(s1) = 1, errors, including rounding errors, may first grow by e^{s1 T}.
//
// For a semidefinite M whose null space does not move the state, the same holds in the norm of its range, |S^1/2 y|.
// There kappa_d = |S^+/2 W_d S^+/2|_2, or L |D^{-1} W_d S^+/2|_2 where N sees the null space
// (core/kernel/monotone_range.hpp).

#include "../kernel/discrete_problem.hpp"
#include "../kernel/monotone_range.hpp"
#include "../kernel/recurrence.hpp"
#include "../kernel/weights.hpp"

namespace bromwich {

struct Forecast {
  double lipschitz = 0;    ///< L; infinite if SOL(M, .) is not known to be Lipschitz, also where it is on a range
  double kappa0 = 0;       ///< of lag 0
  double growth_rate = 0;  ///< s1, 1/time; 0 if khat(0) < 1
  double sweeps = 0;       ///< bound of the number of sweeps to the tolerance; infinite if none is known

  /// The longest horizon on which the iteration is reliable: kappa_0 < 1/2, and rounding errors, amplified by e^{s1 T},
  /// stay below the tolerance. Infinite without growth, 0 for a larger kappa_0.
  double longest_window(double tolerance) const;
};

/// kappa_0 only, from |W_0| 1; infinite if M is neither H+ nor a P-matrix with a known L.
double instant_contraction(const LcpMatrix& M, LcpClass, const Vector& row_sums);

/// The 2-norm where modes diagonalise M: max_l |w0_l| / M_l.
double instant_contraction(const Vector& eigenvalues_of_M, const ModalRecurrence&);

/// The same of these weights, for M + W_0 to be monotone on the range of M. On a face whose modes diagonalise M, the
/// 2-norm.
double instant_contraction(const LcpMatrix& M, LcpClass, const Weights&, const RangeOfM& = {});

Forecast forecast(const LcpMatrix& M, const LagTable&, double h, double tolerance, const RangeOfM& = {});

}  // namespace bromwich

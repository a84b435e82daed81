#pragma once
// A kernel as a short sum of real exponentials. On [h, T] the trace kernel of one grid line, k(t) = n^T e^{across t} b,
// has numerical rank 15 to 50, independent of the number of grid points. Rates are picked from a logarithmic grid by a
// column-pivoted QR of the sampled exponentials (interpolative decomposition: the picked columns represent all others
// with small coefficients). Coefficients are a least-squares fit to contour values.

#include "kernel.hpp"

#include <optional>

namespace bromwich {

struct ExponentialSum {
  Vector rates;         ///< K, each <= 0, 1/time
  Vector coefficients;  ///< K
  double error = 0;     ///< max |k(t) - Σ c_k e^{s_k t}| over check points between the samples, relative to max |k|
};

/// Error at which the fit stops growing, and error up to which it may replace the eigenvalues.
inline constexpr double compression_tolerance = 1e-13, accepted_compression_error = 1e-11;

/// Fits n^T e^{across t} b on [h, T]. The number of rates grows until `tolerance` is met or no rate is left. The result
/// is the largest fit whose last rate reduced the error by a factor of 1.19 or more. The error is infinite if the
/// kernel has decayed at t = h.
ExponentialSum compress_line_kernel(const KroneckerDynamics&, double h, double T,
                                    double tolerance = compression_tolerance);

/// The response to x0 by the same exponentials: S N e^{At} x0 = Σ_k D_kl e^{(s_k + mu_l) t} in mode l, t in [h, T].
struct InitialSum {
  RowMatrix coefficients;  ///< D, K x n
  /// 2-norm over all modes, relative to Σ_k |n_k| |x0_k| in the eigenvectors of a line. Estimated from e^{nu t} of each
  /// eigenvalue between the samples, with a factor of 4 for other times.
  double error = 0;
};

/// Every e^{nu_k t} by the exponentials of a sum, for any x0 and without evaluating time points.
struct InitialFit {
  Matrix P;       ///< rates x across.points: seen_k e^{nu_k t} = Σ_i P_ik e^{s_i t}
  Vector missed;  ///< across.points: largest deviation between the samples
  Vector seen;    ///< across.points: n in the eigenvectors of a line
};
InitialFit fit_initial_response(Backend&, const KroneckerDynamics&, const ExponentialSum&, double h, double T);

InitialSum compress_initial_response(Backend&, const KroneckerDynamics&, const InitialFit&, const Vector& x0);

/// The recurrence with x0 in `initial` = D E / C, for any grid. Empty if a C_k is zero.
std::optional<ModalRecurrence> started(const ModalRecurrence&, const RowMatrix& D);

/// The recurrence with these exponentials instead of all eigenvalues. Lags 0 and 1 come from the contour; mode l uses
/// the rates s_k + mu_l.
ModalRecurrence compressed_recurrence(Backend&, const KroneckerDynamics&, const ExponentialSum&, double h);

}  // namespace bromwich

#pragma once
// A kernel as a short sum of real exponentials: on [h, T] the trace kernel of one grid line,
// k(t) = n^T e^{across t} b, has numerical rank 15 to 50 whatever the number of grid points. Rates are picked from a
// logarithmic grid by a column-pivoted QR of the sampled exponentials (an interpolative decomposition: the picked
// columns represent all others with small coefficients), the coefficients by least squares against contour values.

#include "kernel.hpp"

#include <optional>

namespace bromwich {

struct ExponentialSum {
  Vector rates;         ///< K, each <= 0, 1/time
  Vector coefficients;  ///< K
  double error = 0;     ///< max |k(t) - Σ c_k e^{s_k t}| over check points between the samples, relative to max |k|
};

/// Where the fit stops growing, and the error up to which it may replace the eigenvalues.
inline constexpr double compression_tolerance = 1e-13, accepted_compression_error = 1e-11;

/// Fits n^T e^{across t} b on [h, T]. The number of rates grows until `tolerance` is met or there are no more. Of these
/// fits a larger one is taken only if each further rate reduces the error by a factor of 1.19. The error is infinite
/// where nothing of the kernel is left at t = h.
ExponentialSum compress_line_kernel(const KroneckerDynamics&, double h, double T,
                                    double tolerance = compression_tolerance);

/// x0 seen through the same exponentials: S N e^{At} x0 = Σ_k D_kl e^{(s_k + mu_l) t} in mode l, t in [h, T].
struct InitialSum {
  RowMatrix coefficients;  ///< D, K x n
  /// Of all modes together, in the 2-norm, relative to the sum of the parts Σ_k |n_k| |x0_k| in the eigenvectors of a
  /// line. Estimated from each eigenvalue's e^{nu t} between the samples, with a factor of 4 for other times.
  double error = 0;
};

/// Every e^{nu_k t} by the exponentials of a sum, so that no time point is looked at; for any x0.
struct InitialFit {
  Matrix P;       ///< rates x across.points: e^{nu_k t} = Σ_i P_ik e^{s_i t}, times what is seen of it
  Vector missed;  ///< across.points: largest deviation between the samples
  Vector seen;    ///< across.points: n in the eigenvectors of a line
};
InitialFit fit_initial_response(Backend&, const KroneckerDynamics&, const ExponentialSum&, double h, double T);

InitialSum compress_initial_response(Backend&, const KroneckerDynamics&, const InitialFit&, const Vector& x0);

/// The recurrence with what x0 adds to z_0: `initial` = D E / C, for any grid. Empty where a C_k is zero.
std::optional<ModalRecurrence> started(const ModalRecurrence&, const RowMatrix& D);

/// The recurrence with these exponentials in place of all eigenvalues: lags 0 and 1 come from the contour, and each
/// mode l uses the rates s_k + mu_l.
ModalRecurrence compressed_recurrence(Backend&, const KroneckerDynamics&, const ExponentialSum&, double h);

}  // namespace bromwich

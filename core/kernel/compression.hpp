#pragma once
// A kernel as a short sum of real exponentials. On [h, T] the trace kernel of one grid line, k(t) = n^T e^{across t} b,
// has numerical rank 15 to 50, independent of the number of grid points. Rates are picked from a logarithmic grid by a
// column-pivoted QR of the sampled exponentials (interpolative decomposition: the picked columns represent all others
// with small coefficients). Coefficients are a least-squares fit to contour values.

#include "kernel.hpp"

#include <memory>
#include <optional>

namespace bromwich {

struct ExponentialSum {
  Vector rates;         ///< K, each <= 0, 1/time
  Matrix coefficients;  ///< K x families of lines (KroneckerDynamics)
  double error = 0;     ///< max |k(t) - Σ c_k e^{s_k t}| over check points between the samples, relative to max |k|
};

/// Error at which the fit stops growing, and error up to which it may replace the eigenvalues.
inline constexpr double compression_tolerance = 1e-13, accepted_compression_error = 1e-11;

/// Fits n^T e^{across t} b on [h, T]. The number of rates grows until `tolerance` is met or no rate is left. Of these
/// fits a larger one is taken only if each further rate reduces the error by a factor of 1.19. The error is infinite if
/// the kernel has decayed at t = h.
ExponentialSum compress_line_kernel(const KroneckerDynamics&, double h, double T,
                                    double tolerance = compression_tolerance);

/// The response to x0 by the same exponentials: S N e^{At} x0 = Σ_k D_kl e^{(s_k + mu_l) t} in mode l, t in [h, T], for
/// any x0 and without evaluating time points. With e^{nu_k t} = Σ_i C_ik e^{s_i t} and n_k the component of n in
/// eigenvector k of a line, D = P X^T S, P_iq = Σ_k C_ik n_k S_kq, X the lines of x0.
class InitialProjection {
 public:
  InitialProjection(Backend&, const KroneckerDynamics&, const RowMatrix& P);
  /// D of this x0, rates x n: valid until the next call.
  const Array& operator()(const Vector& x0);

 private:
  Backend& backend_;
  KroneckerDynamics dynamics_;
  std::unique_ptr<Array> P_, values_, modes_;
  std::unique_ptr<RowTransform> to_modes_;
};
struct InitialFit {
  Vector missed;  ///< across.points: largest deviation between the samples
  Vector seen;    ///< across.points: n in the eigenvectors of a line
  std::shared_ptr<InitialProjection> project;
};
InitialFit fit_initial_response(Backend&, const KroneckerDynamics&, const ExponentialSum&, double h, double T);

/// Error of the response to this x0: 2-norm over all modes, relative to Σ_k |n_k| |x0_k| in the eigenvectors of a line.
/// Estimated from e^{nu t} between the samples, with a factor of 4 for other times. The eigenvalue with the largest
/// error decides or, if that error is too large, all eigenvalues and the components of this x0.
double initial_error(Backend&, const KroneckerDynamics&, const InitialFit&, const Vector& x0);

/// Contribution of x0 to z_0 of a recurrence: `initial` = D E / C, for any grid. Empty if a C_k is zero.
std::optional<RowMatrix> start_of(const ModalRecurrence&, const RowMatrix& D, const HostThreads& = HostThreads());
/// The recurrence with it.
std::optional<ModalRecurrence> started(const ModalRecurrence&, const RowMatrix& D, const HostThreads& = HostThreads());

/// The recurrence with these exponentials instead of all eigenvalues. Lags 0 and 1 come from the contour; mode l uses
/// the rates s_k + mu_l.
ModalRecurrence compressed_recurrence(Backend&, const KroneckerDynamics&, const ExponentialSum&, double h);

}  // namespace bromwich

#pragma once
// Real Fourier and sine transforms of one vector, by FFTW (real_fft_fftw.cpp) or by pocketfft (real_fft_pocketfft.cpp).
// BROMWICH_TRANSFORM selects the file at link time. Copies share a plan; threads may execute it on arrays of their own.

#include "core/base/types.hpp"

#include <memory>
#include <utility>

namespace bromwich::cpu {

using Spectra = Eigen::Matrix<Complex, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Columns with which rows begin every 64 bytes: they are aligned alike, and results do not depend on whose row of
/// scratch memory a thread has taken.
inline Index padded(Index columns) { return (columns + 3) / 4 * 4; }

/// "FFTW" or "pocketfft".
const char* transform_library();

/// Discrete Fourier transforms of N real values, N >= 1, in buffers of the caller.
class RealFft {
 public:
  /// Throws Error if there is no plan of this length.
  explicit RealFft(Index length);
  /// Without `backward`; the buffers are aligned as Eigen allocates them.
  static RealFft forward_of_aligned(Index length);

  Index length() const { return length_; }
  Index frequencies() const { return length_ / 2 + 1; }
  /// out_k = sum_j in_j exp(-2 pi i jk/N), k = 0..N/2. `in` is not changed; no aliasing.
  void forward(const double* in, Complex* out) const;
  /// out_j = sum_k in_k exp(2 pi i jk/N) over all N frequencies, the other half being conjugate. `in` is overwritten;
  /// no aliasing.
  void backward(Complex* in, double* out) const;

 private:
  struct Plan;
  RealFft(Index length, std::shared_ptr<const Plan> plan) : length_(length), plan_(std::move(plan)) {}

  Index length_;
  std::shared_ptr<const Plan> plan_;
};

/// out_k = 2 sum_j in_j sin(pi (j+1)(k+1)/(n+1)), j, k = 0..n-1, for any n >= 1. `in` is not changed; no aliasing.
class SineFft {
 public:
  explicit SineFft(Index n);
  void apply(const double* in, double* out) const;

 private:
  struct Plan;
  std::shared_ptr<const Plan> plan_;
};

}  // namespace bromwich::cpu

#pragma once
// Real transforms along time, and the damping that keeps them accurate for growing weights.

#include "core/error.hpp"
#include "cpu/parts.hpp"

#include <fftw3.h>

#include <cmath>

namespace bromwich::cpu {

using Spectra = Eigen::Matrix<Complex, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Real transforms of one length between user buffers.
class RealFft {
 public:
  explicit RealFft(Index length) : length_(length) {
    Vector real(length);
    ComplexVector complex(length / 2 + 1);
    auto* c = reinterpret_cast<fftw_complex*>(complex.data());
    const std::lock_guard lock(fftw_planner());
    forward_ = fftw_plan_dft_r2c_1d(int(length), real.data(), c, FFTW_ESTIMATE | FFTW_UNALIGNED);
    backward_ = fftw_plan_dft_c2r_1d(int(length), c, real.data(), FFTW_ESTIMATE | FFTW_UNALIGNED);
    if (!forward_ || !backward_)
      throw Error("steps", "FFTW made no plan of length " + std::to_string(length), "use fewer steps");
  }
  ~RealFft() {
    const std::lock_guard lock(fftw_planner());
    fftw_destroy_plan(forward_);
    fftw_destroy_plan(backward_);
  }
  RealFft(const RealFft&) = delete;
  RealFft& operator=(const RealFft&) = delete;

  Index length() const { return length_; }
  Index frequencies() const { return length_ / 2 + 1; }
  void forward(double* in, Complex* out) const {
    fftw_execute_dft_r2c(forward_, in, reinterpret_cast<fftw_complex*>(out));
  }
  void backward(Complex* in, double* out) const {
    fftw_execute_dft_c2r(backward_, reinterpret_cast<fftw_complex*>(in), out);
  }

 private:
  Index length_;
  fftw_plan forward_, backward_;
};

/// sigma >= 0 per row: how fast the second half of the table outgrows the first.
inline double growth(const RowMatrix& W) {
  const Index half = W.rows() / 2;
  const double early = half > 0 ? W.topRows(half).cwiseAbs().maxCoeff() : 0,
               late = W.bottomRows(W.rows() - half).cwiseAbs().maxCoeff();
  return early > 0 && late > 10 * early ? std::log(late / early) / double(half) : 0;
}

/// e^{-sigma j}, j = 0..rows-1.
inline Vector damping(double sigma, Index rows) {
  Vector e(rows);
  for (Index j = 0; j < rows; ++j) e[j] = std::exp(-sigma * double(j));
  return e;
}

}  // namespace bromwich::cpu

#pragma once
// Real FFTs along time.

#include "core/base/error.hpp"
#include "cpu/parts.hpp"

#include <fftw3.h>

#include <cmath>

namespace bromwich::cpu {

using Spectra = Eigen::Matrix<Complex, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Real FFTs of one length, in buffers of the caller.
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

}  // namespace bromwich::cpu

// Causal convolution with tabulated lag weights by FFT of length N >= 2J: v = F^{-1}(F(W) F(y)). Columns are batched in
// their time-major layout. Growing weights are damped by e^{-sigma t} first.

#include "kernels/parts.hpp"

#include "core/base/error.hpp"

#include <cufft.h>

#include <string>

namespace bromwich::cuda {

namespace {

void check(cufftResult status, const char* what) {
  if (status != CUFFT_SUCCESS)
    throw Error("cuda", std::string(what) + " failed with cuFFT error " + std::to_string(int(status)),
                "use fewer steps or the cpu backend");
}

using cuda::check;

/// The smallest 2^a 3^b 5^c >= n.
Index fast_length(Index n) {
  for (;; ++n) {
    Index rest = n;
    for (const Index factor : {2, 3, 5})
      while (rest % factor == 0) rest /= factor;
    if (rest == 1) return n;
  }
}

/// Real columns in time to spectra and back, `columns` at a time.
class Transforms {
 public:
  Transforms(const Device& device, Index length, Index columns) {
    int n = int(length), stride = int(columns);
    check(cufftPlanMany(&forward_, 1, &n, &n, stride, 1, &n, stride, 1, CUFFT_D2Z, stride), "planning a convolution");
    check(cufftPlanMany(&backward_, 1, &n, &n, stride, 1, &n, stride, 1, CUFFT_Z2D, stride), "planning a convolution");
    check(cufftSetStream(forward_, device.stream()), "planning a convolution");
    check(cufftSetStream(backward_, device.stream()), "planning a convolution");
  }
  ~Transforms() {
    cufftDestroy(forward_);
    cufftDestroy(backward_);
  }
  Transforms(const Transforms&) = delete;
  Transforms& operator=(const Transforms&) = delete;

  void forward(double* in, cufftDoubleComplex* out) { check(cufftExecD2Z(forward_, in, out), "a convolution"); }
  void backward(cufftDoubleComplex* in, double* out) { check(cufftExecZ2D(backward_, in, out), "a convolution"); }

 private:
  cufftHandle forward_ = 0, backward_ = 0;
};

// y_1 .. y_J, damped and padded with zeros; y_0 has its own column of weights.
__global__ void pad(const double* y, const double* damping, long rows, int columns, int step, long length,
                    double* out) {
  const long count = length * columns;
  for (long i = blockIdx.x * long(blockDim.x) + threadIdx.x; i < count; i += long(gridDim.x) * blockDim.x)
    out[i] = i < (rows - 1) * columns ? damping[i / columns + 1] * y[(i / columns + 1) * step + i % columns] : 0;
}

__global__ void multiply(const cufftDoubleComplex* W, const cufftDoubleComplex* Y, long frequencies, int outputs,
                         int inputs, bool modal, double scale, cufftDoubleComplex* V) {
  const long count = frequencies * outputs;
  for (long at = blockIdx.x * long(blockDim.x) + threadIdx.x; at < count; at += long(gridDim.x) * blockDim.x) {
    const long f = at / outputs;
    const int i = int(at % outputs);
    double re = 0, im = 0;
    for (int e = modal ? i : 0; e < (modal ? i + 1 : inputs); ++e) {
      const cufftDoubleComplex w = modal ? W[at] : W[(f * outputs + i) * inputs + e], u = Y[f * inputs + e];
      re += w.x * u.x - w.y * u.y;
      im += w.x * u.y + w.y * u.x;
    }
    V[at] = {scale * re, scale * im};
  }
}

// Writes v_j, j >= 1, from the convolution of y_1, .. plus the contribution of y_0.
__global__ void take(const double* convolved, const double* damping, const double* S, const double* y0, long rows,
                     int outputs, int inputs, int step, bool modal, double* v) {
  const long count = rows * outputs;
  for (long at = blockIdx.x * long(blockDim.x) + threadIdx.x; at < count; at += long(gridDim.x) * blockDim.x) {
    const long j = at / outputs;
    const int i = int(at % outputs);
    double sum = 0;
    if (j > 0) {
      sum = convolved[at - outputs] / damping[j];
      for (int e = modal ? i : 0; e < (modal ? i + 1 : inputs); ++e) sum += S[modal ? at : at * inputs + e] * y0[e];
    }
    v[j * step + i] = sum;
  }
}

class FftConvolution final : public Convolution {
 public:
  FftConvolution(const Device& device, const LagTable& table, Index rows)
      : device_(device),
        rows_(rows),
        outputs_(table.outputs),
        inputs_(table.inputs),
        modal_(table.modal),
        length_(fast_length(std::max<Index>(2, 2 * (rows - 1)))),
        in_(device, length_, inputs_),
        out_(device, length_, outputs_),
        damping_(on_device(device, damping(growth(table.W), rows))),
        S_(on_device(device, table.S)),
        real_(device, std::size_t(length_ * std::max(inputs_, outputs_))),
        y_spectrum_(device, std::size_t(frequencies() * inputs_)),
        v_spectrum_(device, std::size_t(frequencies() * outputs_)),
        weights_(device, std::size_t(frequencies() * table.W.cols())) {
    Transforms all(device, length_, table.W.cols());
    RowMatrix W = RowMatrix::Zero(length_, table.W.cols());
    const Vector damped = damping(growth(table.W), rows);
    for (Index d = 0; d + 1 < rows; ++d) W.row(d) = damped[d] * table.W.row(d);
    Memory<double> lags = on_device(device, W);
    all.forward(lags.data(), weights_.data());
    device.wait();
  }

  void apply(const Array& y, Array& v, Index) override {
    const cudaStream_t stream = device_.stream();
    const unsigned blocks = unsigned(8 * device_.multiprocessors());
    pad<<<blocks, 256, 0, stream>>>(values(y), damping_.data(), rows_, int(inputs_), int(stride(inputs_)), length_,
                                    real_.data());
    in_.forward(real_.data(), y_spectrum_.data());
    multiply<<<blocks, 256, 0, stream>>>(weights_.data(), y_spectrum_.data(), frequencies(), int(outputs_),
                                         int(inputs_), modal_, 1 / double(length_), v_spectrum_.data());
    out_.backward(v_spectrum_.data(), real_.data());
    take<<<blocks, 256, 0, stream>>>(real_.data(), damping_.data(), S_.data(), values(y), rows_, int(outputs_),
                                     int(inputs_), int(stride(outputs_)), modal_, values(v));
    check(cudaGetLastError(), "starting the convolution");
  }

  std::size_t bytes() const override {
    return S_.bytes() + real_.bytes() + y_spectrum_.bytes() + v_spectrum_.bytes() + weights_.bytes();
  }

 private:
  Index frequencies() const { return length_ / 2 + 1; }

  const Device& device_;
  Index rows_, outputs_, inputs_;
  bool modal_;
  Index length_;
  Transforms in_, out_;
  Memory<double> damping_, S_, real_;
  Memory<cufftDoubleComplex> y_spectrum_, v_spectrum_, weights_;
};

}  // namespace

std::unique_ptr<Convolution> make_convolution(const Device& device, const LagTable& table, Index rows) {
  return std::make_unique<FftConvolution>(device, table, rows);
}

}  // namespace bromwich::cuda

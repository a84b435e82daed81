// The orthonormal sine transform of rows where kernels/transform_rows.cu does not apply. Up to `largest_product` points
// it is a product with the dense matrix; tensor cores are faster than an FFT of awkward length. Beyond, the odd
// extension of each row goes through cuFFT.

#include "kernels/blas.hpp"
#include "kernels/parts.hpp"

#include "core/base/error.hpp"
#include "core/numerics/sine_basis.hpp"

#include <cufft.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

namespace bromwich::cuda {

namespace {

constexpr Index largest_product = 1536;  ///< on an H200 the break-even lies between 1535 and 2047 points

void check(cufftResult status, const char* what) {
  if (status != CUFFT_SUCCESS)
    throw Error("cuda", std::string(what) + " failed with cuFFT error " + std::to_string(int(status)),
                "use fewer steps or the cpu backend");
}

using cuda::check;

/// n x n, padded with zeros up to the stride, so that the padding of an array stays zero.
struct PaddedMatrix {
  PaddedMatrix(const Device& device, const Matrix& P) : n(P.rows()), values(on_device(device, padded(P))) {}

  static Matrix padded(const Matrix& P) {
    Matrix filled = Matrix::Zero(stride(P.rows()), stride(P.rows()));
    filled.topLeftCorner(P.rows(), P.rows()) = P;
    return filled;
  }

  Index n;
  Memory<double> values;
};

struct SineTable : PaddedMatrix {
  SineTable(const Device& device, Index n) : PaddedMatrix(device, sine_matrix(n)) {}
};

class RowProduct final : public RowTransform {
 public:
  RowProduct(const Device& device, std::shared_ptr<const PaddedMatrix> P)
      : device_(device), n_(stride(P->n)), blas_(shared_blas(device)), P_(std::move(P)) {}

  // Rows are columns to cuBLAS: out^T = P in^T + add^T.
  void apply(const Array& in, const Array* add, Array& out, Index first) override {
    const Index rows = in.rows() - first, offset = first * n_;
    if (rows <= 0 || n_ == 0) return;
    const double one = 1, beta = add ? 1 : 0;
    if (add && add != &out)
      check(cudaMemcpyAsync(values(out) + offset, values(*add) + offset, sizeof(double) * std::size_t(rows * n_),
                            cudaMemcpyDeviceToDevice, device_.stream()),
            "copying on the device");
    check(cublasDgemm(blas_->handle, CUBLAS_OP_N, CUBLAS_OP_N, int(n_), int(rows), int(n_), &one, P_->values.data(),
                      int(n_), values(in) + offset, int(n_), &beta, values(out) + offset, int(n_)),
          "the transform");
  }

  std::size_t bytes() const override { return P_->values.bytes(); }

 private:
  const Device& device_;
  Index n_;  ///< including the padding
  std::shared_ptr<Blas> blas_;
  std::shared_ptr<const PaddedMatrix> P_;
};

// 0, x_1, ..., x_n, 0, -x_n, ..., -x_1: the odd extension.
__global__ void extend(const double* in, int n, int stride, double* out) {
  const int length = 2 * (n + 1);
  const long row = blockIdx.x;
  for (int i = threadIdx.x; i < length; i += blockDim.x) {
    double value = 0;
    if (i > 0 && i <= n) value = in[row * stride + i - 1];
    if (i > n + 1) value = -in[row * stride + length - i - 1];
    out[row * length + i] = value;
  }
}

__global__ void take_imaginary(const cufftDoubleComplex* spectrum, int n, int stride, double scale, const double* add,
                               double* out) {
  const long row = blockIdx.x;
  for (int i = threadIdx.x; i < n; i += blockDim.x)
    out[row * stride + i] = (add ? add[row * stride + i] : 0) - scale * spectrum[row * (n + 2) + i + 1].y;
}

class SineFft final : public RowTransform {
 public:
  SineFft(const Device& device, Index n, Index rows)
      : device_(device),
        n_(n),
        batch_(std::min<Index>(rows, 256)),
        extended_(device, std::size_t(batch_ * 2 * (n + 1))),
        spectrum_(device, std::size_t(batch_ * (n + 2))) {
    int length = int(2 * (n + 1));
    check(cufftPlanMany(&plan_, 1, &length, nullptr, 1, length, nullptr, 1, int(n + 2), CUFFT_D2Z, int(batch_)),
          "planning the sine transform");
    check(cufftSetStream(plan_, device.stream()), "planning the sine transform");
  }
  ~SineFft() override { cufftDestroy(plan_); }

  void apply(const Array& in, const Array* add, Array& out, Index first) override {
    const Index step = stride(n_);
    for (Index j = first; j < in.rows(); j += batch_) {
      const unsigned count = unsigned(std::min(batch_, in.rows() - j));
      extend<<<count, 256, 0, device_.stream()>>>(values(in) + j * step, int(n_), int(step), extended_.data());
      check(cufftExecD2Z(plan_, extended_.data(), spectrum_.data()), "the sine transform");
      take_imaginary<<<count, 256, 0, device_.stream()>>>(
          spectrum_.data(), int(n_), int(step), 0.5 * std::sqrt(2.0 / double(n_ + 1)),
          add ? values(*add) + j * step : nullptr, values(out) + j * step);
      check(cudaGetLastError(), "the sine transform");
    }
  }

  std::size_t bytes() const override { return extended_.bytes() + spectrum_.bytes(); }

 private:
  const Device& device_;
  Index n_, batch_;
  Memory<double> extended_;
  Memory<cufftDoubleComplex> spectrum_;
  cufftHandle plan_ = 0;
};

}  // namespace

std::unique_ptr<RowTransform> make_sine_product(const Device& device, Index n) {
  return std::make_unique<RowProduct>(device,
                                      device.shared<SineTable>([n](const SineTable& kept) { return kept.n == n; },
                                                               [&] { return std::make_shared<SineTable>(device, n); }));
}

std::unique_ptr<RowTransform> make_row_product(const Device& device, const Matrix& P) {
  return std::make_unique<RowProduct>(device, std::make_shared<PaddedMatrix>(device, P));
}

std::unique_ptr<RowTransform> make_sine_fft(const Device& device, Index n, Index rows) {
  return std::make_unique<SineFft>(device, n, rows);
}

std::unique_ptr<RowTransform> make_sine_transform(const Device& device, Index n, Index rows) {
  if (has_sine_rows(n)) return make_sine_rows(device, n);
  return n <= largest_product ? make_sine_product(device, n) : make_sine_fft(device, n, rows);
}

}  // namespace bromwich::cuda

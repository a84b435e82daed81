// Causal convolution along time with one weight per lag and mode, as the sum that it is: for few rows, where any other
// way takes several kernels whose start costs more. A thread has four rows of one mode; the weights that they need
// shift by one from one row of y to the next. rows^2 / 2 multiply-adds a mode.

#include "kernels/parts.hpp"

#include <algorithm>

namespace bromwich::cuda {

namespace {

constexpr int lanes = 32, warps = 4;  ///< of a block, neighbouring modes and groups of rows
constexpr int own = 4;                ///< rows of a thread

__global__ void __launch_bounds__(lanes* warps)
    convolve(const double* __restrict__ W, const double* __restrict__ S, int modes, int stride, int step, int rows,
             const double* __restrict__ y, double* __restrict__ v) {
  const int l = int(blockIdx.x) * lanes + int(threadIdx.x);
  const int group = int(blockIdx.y) * warps + int(threadIdx.y), j = 1 + group * own;
  if (l >= modes) return;
  if (group == 0) v[l] = 0;
  if (j >= rows) return;
  double sum[own], w[own];  // w[g]: the weight of row i of y in row j + g, 0 where i > j + g
  const double y0 = y[l];
#pragma unroll
  for (int g = 0; g < own; ++g) {
    sum[g] = S[(j + g) * stride + l] * y0;
    w[g] = W[(j + g - 1) * stride + l];
  }
  const int last = min(rows, j + own);
#pragma unroll 8
  for (int i = 1; i < last; ++i) {
    const double value = y[long(i) * step + l];
    const int lag = j - i - 1;
    const double next = lag >= 0 ? W[lag * stride + l] : 0;
#pragma unroll
    for (int g = 0; g < own; ++g) sum[g] += w[g] * value;
#pragma unroll
    for (int g = own - 1; g > 0; --g) w[g] = w[g - 1];
    w[0] = next;
  }
#pragma unroll
  for (int g = 0; g < own; ++g)
    if (j + g < rows) v[long(j + g) * step + l] = sum[g];
}

class DirectConvolution final : public Convolution {
 public:
  DirectConvolution(const Device& device, const LagTable& table, Index rows)
      : device_(device),
        n_(table.outputs),
        stride_((n_ + lanes - 1) / lanes * lanes),
        rows_(rows),
        W_(on_device(device, padded(table.W))),
        S_(on_device(device, padded(table.S))) {}

  void apply(const Array& y, Array& v, Index) override {
    const Index groups = std::max<Index>(1, (rows_ - 1 + own - 1) / own);
    const dim3 blocks(unsigned(stride_ / lanes), unsigned((groups + warps - 1) / warps));
    convolve<<<blocks, dim3(lanes, warps), 0, device_.stream()>>>(W_.data(), S_.data(), int(n_), int(stride_),
                                                                  int(stride(n_)), int(rows_), values(y), values(v));
    check(cudaGetLastError(), "starting a convolution");
  }

  std::size_t bytes() const override { return W_.bytes() + S_.bytes(); }

 private:
  // Zeros for the rows that a thread may have beyond the last.
  RowMatrix padded(const RowMatrix& table) const {
    RowMatrix all = RowMatrix::Zero(rows_ + own, stride_);
    const Index given = std::min(table.rows(), rows_);
    all.topLeftCorner(given, n_) = table.topRows(given);
    return all;
  }

  const Device& device_;
  Index n_, stride_, rows_;
  Memory<double> W_, S_;
};

}  // namespace

std::unique_ptr<Convolution> make_direct_convolution(const Device& device, const LagTable& table, Index rows) {
  return std::make_unique<DirectConvolution>(device, table, rows);
}

}  // namespace bromwich::cuda

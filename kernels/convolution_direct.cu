// Causal convolution along time with one weight per lag and mode, as the sum that it is: for few rows, where a scan is
// three kernels whose start costs more than their work. A thread has `own` neighbouring rows of one mode, so that a
// value of y and a weight serve `own` multiply-adds: the weights that the rows need shift by one from one row of y to
// the next. The warps of a block share the rows of y among them and add up what each has found, always in one order.
// rows^2 / 2 multiply-adds a mode.

#include "kernels/parts.hpp"

#include <algorithm>

namespace bromwich::cuda {

namespace {

constexpr int lanes = 32, parts = 8;  ///< of a block: neighbouring modes, and the warps that share the rows of y
constexpr int most_own = 16;          ///< rows of v of a thread
constexpr Index few_rows = 160;       ///< below which threads have half as many
constexpr int before = most_own + 8, beyond = most_own;  ///< rows of zeros around the weights
constexpr int lags = 16;                                     ///< of a thread that forms weights

/// W_0 w1 s1: n; the others K x n.
struct Exponentials {
  const double *decay, *output, *start, *w0, *w1, *s1;
  int count, modes;
};

// W_d = C E^{d-1}, S_d = C E^{d-1} G0, d >= 1 (core/recurrence.hpp).
__global__ void form_weights(Exponentials r, int rows, int stride, double* __restrict__ W, double* __restrict__ S) {
  const int l = int(blockIdx.x) * int(blockDim.x) + int(threadIdx.x), first = int(blockIdx.y) * lags;
  if (l >= r.modes) return;
  double sum[lags] = {}, of_start[lags] = {};
  for (int k = 0; k < r.count; ++k) {
    const int at = k * r.modes + l;
    const double E = r.decay[at], G0 = r.start[at];
    double weight = r.output[at] * pow(E, double(max(first - 1, 0)));
#pragma unroll
    for (int i = 0; i < lags; ++i) {
      if (first + i == 0) continue;
      sum[i] += weight;
      of_start[i] += weight * G0;
      weight *= E;
    }
  }
#pragma unroll
  for (int i = 0; i < lags; ++i) {
    const int d = first + i;
    if (d >= rows) return;
    W[long(d) * stride + l] = d == 0 ? r.w0[l] : d == 1 ? sum[i] + r.w1[l] : sum[i];
    S[long(d) * stride + l] = d == 0 ? 0 : d == 1 ? of_start[i] + r.s1[l] : of_start[i];
  }
}

template <int own>
__global__ void __launch_bounds__(lanes* parts, 2)
    convolve(const double* __restrict__ W, const double* __restrict__ S, int modes, int stride, int step, int rows,
             const double* __restrict__ y, double* __restrict__ v) {
  constexpr int ahead = 64 / own;  // rows of y that are read at a time
  __shared__ double found[parts][own][lanes];
  const int lane = int(threadIdx.x), part = int(threadIdx.y), l = int(blockIdx.x) * lanes + lane;
  const bool given = l < modes;
  const int j = 1 + int(blockIdx.y) * own;
  const int last = min(rows, j + own), share = (last - 1 + parts - 1) / parts;
  const int from = 1 + part * share, to = min(last, from + share);
  const double* const column = y + (given ? l : 0);
  // w[g]: the weight of row i of y in row j + g, 0 where i > j + g; next[i]: that in row j one and more later.
  double sum[own] = {}, w[own], value[ahead], next[ahead];
  const auto read = [&](int i) {
#pragma unroll
    for (int c = 0; c < ahead; ++c) {
      value[c] = i + c < to ? column[long(i + c) * step] : 0;
      next[c] = W[long(j - i - c - 1) * stride + l];
    }
  };
  if (from < to) {
#pragma unroll
    for (int g = 0; g < own; ++g) w[g] = W[long(j + g - from) * stride + l];
    read(from);
    for (int i = from; i < to; i += ahead) {
      double now[ahead], shifted[ahead];
#pragma unroll
      for (int c = 0; c < ahead; ++c) now[c] = value[c], shifted[c] = next[c];
      if (i + ahead < to) read(i + ahead);
#pragma unroll
      for (int c = 0; c < ahead; ++c) {
#pragma unroll
        for (int g = 0; g < own; ++g) sum[g] += w[g] * now[c];
#pragma unroll
        for (int g = own - 1; g > 0; --g) w[g] = w[g - 1];
        w[0] = shifted[c];
      }
    }
  }
#pragma unroll
  for (int g = 0; g < own; ++g) found[part][g][lane] = sum[g];
  __syncthreads();
  if (!given) return;
  if (j == 1 && part == 0) v[l] = 0;
  const double y0 = column[0];
  for (int g = part; g < own && j + g < rows; g += parts) {
    double all = S[long(j + g) * stride + l] * y0;
#pragma unroll
    for (int p = 0; p < parts; ++p) all += found[p][g][lane];
    v[long(j + g) * step + l] = all;
  }
}

class DirectConvolution final : public Convolution {
 public:
  DirectConvolution(const Device& device, const ModalRecurrence& r, Index rows)
      : device_(device),
        n_(r.modes()),
        stride_((n_ + lanes - 1) / lanes * lanes),
        rows_(rows),
        W_(device, std::size_t((before + rows + beyond) * stride_)),
        S_(device, std::size_t(rows * stride_)) {
    W_.clear();
    const Memory<double> decay = on_device(device, r.decay), output = on_device(device, r.output),
                         start = on_device(device, r.start), w0 = on_device(device, r.w0), w1 = on_device(device, r.w1),
                         s1 = on_device(device, r.s1);
    const Exponentials e{decay.data(), output.data(), start.data(),          w0.data(),
                         w1.data(),    s1.data(),     int(r.exponentials()), int(n_)};
    const dim3 blocks(unsigned((n_ + 127) / 128), unsigned((rows + lags - 1) / lags));
    form_weights<<<blocks, 128, 0, device.stream()>>>(e, int(rows), int(stride_), weights(), S_.data());
    check(cudaGetLastError(), "forming weights");
  }

  void apply(const Array& y, Array& v, Index) override {
    if (rows_ < 2)
      check(cudaMemsetAsync(values(v), 0, sizeof(double) * std::size_t(n_), device_.stream()), "clearing a row");
    else if (rows_ < few_rows)
      start<most_own / 2>(values(y), values(v));
    else
      start<most_own>(values(y), values(v));
  }

  std::size_t bytes() const override { return W_.bytes() + S_.bytes(); }

 private:
  double* weights() { return W_.data() + before * stride_; }

  template <int own>
  void start(const double* y, double* v) {
    const dim3 blocks(unsigned(stride_ / lanes), unsigned((rows_ - 1 + own - 1) / own));
    convolve<own><<<blocks, dim3(lanes, parts), 0, device_.stream()>>>(weights(), S_.data(), int(n_), int(stride_),
                                                                       int(stride(n_)), int(rows_), y, v);
    check(cudaGetLastError(), "starting a convolution");
  }

  const Device& device_;
  Index n_, stride_, rows_;
  Memory<double> W_, S_;
};

}  // namespace

std::unique_ptr<Convolution> make_direct_convolution(const Device& device, const ModalRecurrence& r, Index rows) {
  return std::make_unique<DirectConvolution>(device, r, rows);
}

}  // namespace bromwich::cuda

// Causal convolution along time with one weight per lag and mode, as the sum that it is: for modes that remember few
// rows, and for few rows, where a scan is three kernels whose start costs more than their work. A thread has `own`
// neighbouring rows of one mode, so that a value of y and a weight serve `own` multiply-adds: the weights that the rows
// need shift by one from one row of y to the next. A warp works alone where 32 modes remember little; where they
// remember more, two, four or all of a block share the rows of y among them and add up what each has found, always in
// one order.

#include "kernels/parts.hpp"

#include <cuda_pipeline_primitives.h>

#include <algorithm>

namespace bromwich::cuda {

namespace {

constexpr int lanes = 32, warps = 8;                 ///< of a block: neighbouring modes, and its warps
constexpr int most_own = 16;                         ///< rows of v of a thread
constexpr int few_rows = 160;                        ///< below which threads have half as many
constexpr int rows_alone = 40;                       ///< of y, that a warp takes by itself
constexpr int before = most_own, beyond = most_own;  ///< rows of zeros around the weights
constexpr int lags = 16;                             ///< of a thread that forms weights

/// W_0 w1 s1: n; the others K x n.
struct Exponentials {
  const double *decay, *output, *start, *w0, *w1, *s1;
  int count, modes;
};

/// Of lags 0 .. longest, `stride` to a row; lengths[g]: the last lag of modes 32 g .. 32 g + 31.
struct Weights {
  const double *W, *S;
  const int* lengths;
  int modes, stride, longest;
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

/// Warps that share `own` rows of modes with `length` lags.
__host__ __device__ constexpr int sharing(int length, int own) {
  int parts = 1;
  while (parts < warps && parts * rows_alone < length + own) parts *= 2;
  return parts;
}

/// What a thread reads ahead of its sums: `stages` times `batch` rows of y and the weights that come with them, copied
/// to shared memory while it works. No other thread sees them.
class Ahead {
 public:
  static constexpr int batch = 4, stages = 4;
  static constexpr std::size_t bytes = sizeof(double) * 2 * batch * stages * lanes * warps;

  __device__ explicit Ahead(double* shared) : own_(shared + threadIdx.y * lanes + threadIdx.x) {}

  /// Copies `count` rows, at most `batch`; value and weight of those beyond are 0.
  template <class Value, class Weight>
  __device__ void copy(int stage, int count, const Value& value, const Weight& weight) {
#pragma unroll
    for (int c = 0; c < batch; ++c) {
      const bool there = c < count;
      __pipeline_memcpy_async(at(stage, 2 * c), value(there ? c : 0), sizeof(double), there ? 0 : sizeof(double));
      __pipeline_memcpy_async(at(stage, 2 * c + 1), weight(there ? c : 0), sizeof(double), there ? 0 : sizeof(double));
    }
  }
  __device__ double value(int stage, int c) const { return *at(stage, 2 * c); }
  __device__ double weight(int stage, int c) const { return *at(stage, 2 * c + 1); }

 private:
  __device__ double* at(int stage, int i) const { return own_ + ((stage % stages) * 2 * batch + i) * (lanes * warps); }
  double* own_;
};

template <int own>
__global__ void __launch_bounds__(lanes* warps, 2)
    convolve(Weights weights, int step, int begin, int rows, const double* __restrict__ y, double* __restrict__ v) {
  constexpr int batch = Ahead::batch, stages = Ahead::stages;
  extern __shared__ double shared[];
  const int length = __ldg(weights.lengths + blockIdx.x), parts = sharing(length, own);
  const int warp = int(threadIdx.y), part = warp % parts, lane = int(threadIdx.x), l = int(blockIdx.x) * lanes + lane;
  const int tile = int(blockIdx.y) * (warps / parts) + warp / parts, j = begin + tile * own;
  if (begin + int(blockIdx.y) * (warps / parts) * own >= rows) return;  // all warps of the block
  const bool given = l < weights.modes;
  const int oldest = max(1, j - length), last = min(rows, j + own);
  const int share = (last - oldest + parts - 1) / parts;
  const int from = oldest + part * share, to = min(last, from + share);
  const double* const column = y + (given ? l : 0);
  const double* const W = weights.W + l;
  // w[g]: the weight of row i of y in row j + g, 0 where i > j + g. Read ahead: row i and the weight that it lets
  // follow.
  double sum[own] = {}, w[own];
  Ahead ahead(shared);
  const auto copy = [&](int stage) {
    const int i = from + stage * batch;
    if (i < to)
      ahead.copy(
          stage, to - i, [&](int c) { return column + long(i + c) * step; },
          [&](int c) { return W + long(j - i - c - 1) * weights.stride; });
    __pipeline_commit();
  };
#pragma unroll
  for (int stage = 0; stage + 1 < stages; ++stage) copy(stage);
  if (from < to) {
#pragma unroll
    for (int g = 0; g < own; ++g) w[g] = W[long(j + g - from) * weights.stride];
  }
  for (int stage = 0; from + stage * batch < to; ++stage) {
    __pipeline_wait_prior(stages - 2);
#pragma unroll
    for (int c = 0; c < batch; ++c) {
      const double now = ahead.value(stage, c);
#pragma unroll
      for (int g = 0; g < own; ++g) sum[g] += w[g] * now;
#pragma unroll
      for (int g = own - 1; g > 0; --g) w[g] = w[g - 1];
      w[0] = ahead.weight(stage, c);
    }
    copy(stage + stages - 1);
  }
  if (j == 1 && part == 0 && given) v[l] = 0;
  const double y0 = column[0];
  const auto put = [&](int g, double all) {
    if (!given || j + g >= rows) return;
    if (j + g <= length) all += weights.S[long(j + g) * weights.stride + l] * y0;
    v[long(j + g) * step + l] = all;
  };
  if (parts == 1) {
#pragma unroll
    for (int g = 0; g < own; ++g) put(g, sum[g]);
    return;
  }
  __pipeline_wait_prior(0);
  __syncthreads();
  const auto found = [&](int of, int g) -> double& { return shared[(of * own + g) * lanes + lane]; };
#pragma unroll
  for (int g = 0; g < own; ++g) found(warp, g) = sum[g];
  __syncthreads();
  for (int g = part; g < own; g += parts) {
    double all = 0;
    for (int p = 0; p < parts; ++p) all += found(warp - part + p, g);
    put(g, all);
  }
}

class DirectConvolution final : public Convolution {
 public:
  DirectConvolution(const Device& device, const ModalRecurrence& r, const std::vector<Index>& lengths, Index begin,
                    Index rows)
      : device_(device),
        first_(begin),
        total_(r.modes()),
        n_(total_ - begin),
        stride_((n_ + lanes - 1) / lanes * lanes),
        rows_(rows),
        lengths_(of_groups(lengths)),
        longest_(*std::max_element(lengths_.begin(), lengths_.end())),
        on_device_(device, lengths_.size()),
        W_(device, std::size_t((before + longest_ + 1 + beyond) * stride_)),
        S_(device, std::size_t((longest_ + 1) * stride_)) {
    W_.clear();
    on_device_.put(lengths_.data());
    const auto slice = [&](const auto& table) { return on_device(device, RowMatrix(table.rightCols(n_))); };
    const Memory<double> decay = slice(r.decay), output = slice(r.output), start = slice(r.start),
                         w0 = slice(r.w0.transpose()), w1 = slice(r.w1.transpose()), s1 = slice(r.s1.transpose());
    const Exponentials e{decay.data(), output.data(), start.data(),          w0.data(),
                         w1.data(),    s1.data(),     int(r.exponentials()), int(n_)};
    const dim3 blocks(unsigned((n_ + 127) / 128), unsigned((longest_ + lags) / lags));
    form_weights<<<blocks, 128, 0, device.stream()>>>(e, longest_ + 1, int(stride_), W_.data() + before * stride_,
                                                      S_.data());
    check(cudaGetLastError(), "forming weights");
    for (const auto kernel : {convolve<most_own>, convolve<most_own / 2>})
      check(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, int(Ahead::bytes)),
            "reserving shared memory");
  }

  void apply(const Array& y, Array& v, Index first) override {
    if (rows_ < 2)
      check(cudaMemsetAsync(values(v) + first_, 0, sizeof(double) * std::size_t(n_), device_.stream()),
            "clearing a row");
    else if (rows_ < few_rows)
      start<most_own / 2>(int(first), values(y) + first_, values(v) + first_);
    else
      start<most_own>(int(first), values(y) + first_, values(v) + first_);
  }

  std::size_t bytes() const override { return W_.bytes() + S_.bytes() + on_device_.bytes(); }

 private:
  std::vector<int> of_groups(const std::vector<Index>& lengths) const {
    std::vector<int> longest(std::size_t(stride_ / lanes), 1);
    for (Index l = 0; l < n_; ++l) {
      int& group = longest[std::size_t(l / lanes)];
      group = std::max(group, int(lengths[std::size_t(first_ + l)]));
    }
    return longest;
  }

  // Rows max(1, first) .. rows - 1 of v.
  template <int own>
  void start(int first, const double* y, double* v) {
    const int begin = std::max(first, 1), rows = int(rows_), tiles = (rows - begin + own - 1) / own;
    if (tiles <= 0) return;
    const int along = warps / sharing(longest_, own);  // tiles of a block, at the fewest
    const dim3 blocks(unsigned(stride_ / lanes), unsigned((tiles + along - 1) / along));
    const Weights weights{W_.data() + before * stride_, S_.data(), on_device_.data(), int(n_), int(stride_), longest_};
    convolve<own><<<blocks, dim3(lanes, warps), Ahead::bytes, device_.stream()>>>(weights, int(stride(total_)), begin,
                                                                                  rows, y, v);
    check(cudaGetLastError(), "starting a convolution");
  }

  const Device& device_;
  Index first_, total_, n_, stride_, rows_;  ///< modes first_ .. total_ - 1 are taken
  std::vector<int> lengths_;
  int longest_;
  Memory<int> on_device_;
  Memory<double> W_, S_;
};

}  // namespace

std::unique_ptr<Convolution> make_direct_convolution(const Device& device, const ModalRecurrence& r,
                                                     const std::vector<Index>& lengths, Index first, Index rows) {
  return std::make_unique<DirectConvolution>(device, r, lengths, first, rows);
}

}  // namespace bromwich::cuda

// Causal convolution along time by direct summation over the lags. Used for modes with a short memory, and for few
// rows, where launching the three kernels of a scan costs more than their work. A thread computes `own` neighbouring
// rows of one mode, so each value of y and each weight is used `own` times; from one row of y to the next the weights
// shift by one. For a short memory each warp works alone. For a longer one, two, four or all warps of a block split the
// rows of y and add up their results in a fixed order.
//
// Sums cover whole batches of rows, padded with weights of 0: an infinite value of y turns up to 14 earlier rows into
// NaN.

#include "kernels/launch.cuh"
#include "kernels/parts.hpp"

#include <cuda_pipeline_primitives.h>

#include <algorithm>

namespace bromwich::cuda {

namespace {

constexpr int lanes = 32, warps = 8;             ///< modes and warps per block
constexpr int own = 8;                           ///< rows of v per thread
constexpr int few_alone = 40, many_alone = 160;  ///< rows of y per warp
constexpr int before = 32, beyond = 32;          ///< rows of zeros around the weights
constexpr int lags = 16;                         ///< lags per thread when weights are formed
constexpr int most_groups = 128;                 ///< groups of 32 modes with their own length
constexpr int few_blocks = 2;   ///< per multiprocessor; above it, early launch costs more than it saves
constexpr int batch = 8;        ///< rows of y added without a bounds check
constexpr int most_near = 192;  ///< largest lag for which weights and rows of y are held in shared memory at once

/// W_0, w1, s1: n entries; the others K x n.
struct Exponentials {
  const double *decay, *output, *start, *w0, *w1, *s1;
  int count, modes;
};

/// For lags 0 .. longest length; rows are `stride` apart.
struct Weights {
  const double *W, *S;
  int modes, stride;
};

/// The last lag of modes 32 g .. 32 g + 31; the last g covers all remaining modes.
struct Lengths {
  int of[most_groups];
  int longest;
  int alone;  ///< rows of y per warp
  int near;   ///< lags up to which weights and rows of y fit into shared memory

  /// Number of warps that share `own` rows of v for modes with `length` lags.
  __host__ __device__ int parts(int length) const {
    int parts = 1;
    while (parts < warps && parts * alone < length + own) parts *= 2;
    return parts;
  }
};

// W_d = C E^{d-1}, S_d = C E^{d-1} G0, d >= 1 (core/seam/recurrence.hpp).
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

/// The work of a block: a warp, or `parts` warps that split the rows of y, computes rows j .. j + own - 1 of v.
struct Share {
  Weights weights;
  int length, parts, step, first, rows;  ///< first: row of v of the block
  int lane = int(threadIdx.x), warp = int(threadIdx.y), part = warp % parts, l = int(blockIdx.y) * lanes + lane;
  int j = first + warp / parts * own;
  bool given = l < weights.modes;

  __device__ int block_rows() const { return warps / parts * own; }
  /// Rows of y per part if they begin at row `oldest`, in whole batches.
  __device__ int portion(int oldest) const {
    return ((j + own - oldest + parts - 1) / parts + batch - 1) / batch * batch;
  }
  __device__ int batches(int from, int portion) const { return (min(j + own - from, portion) + batch - 1) / batch; }

  /// Adds up the parts and writes v. sum[g]: the sum of this part for row j + g.
  __device__ void put(const double (&sum)[own], double* shared, const double* y, double* v) const {
    if (j == 1 && part == 0 && given) v[l] = 0;
    const auto write = [&](int g, double all) {
      if (!given || j + g >= rows) return;
      if (j + g <= length) all += weights.S[long(j + g) * weights.stride + l] * y[l];
      v[long(j + g) * step + l] = all;
    };
    if (parts == 1) {
#pragma unroll
      for (int g = 0; g < own; ++g) write(g, sum[g]);
      return;
    }
    __syncthreads();
    const auto found = [&](int of, int g) -> double& { return shared[(of * own + g) * lanes + lane]; };
#pragma unroll
    for (int g = 0; g < own; ++g) found(warp, g) = sum[g];
    __syncthreads();
    for (int g = part; g < own; g += parts) {
      double all = 0;
      for (int p = 0; p < parts; ++p) all += found(warp - part + p, g);
      write(g, all);
    }
  }
};

/// Adds a batch of rows of y to the sums. w[g]: the weight of the first of them in row j + g. Each row shifts in one
/// new weight.
__device__ void add_batch(const double* value, int value_step, const double* weight, int weight_step, double (&w)[own],
                          double (&sum)[own]) {
#pragma unroll
  for (int c = 0; c < batch; ++c) {
    const double now = value[c * value_step], next = weight[c * weight_step];
#pragma unroll
    for (int g = 0; g < own; ++g) sum[g] += w[g] * now;
#pragma unroll
    for (int g = own - 1; g > 0; --g) w[g] = w[g - 1];
    w[0] = next;
  }
}

/// Short memory: all rows of y and all weights of a block are loaded into shared memory once.
struct Near {
  static constexpr int lag_before = own + batch;  ///< zero weights before lag 0

  __host__ __device__ static int y_rows(int length, int block_rows) { return length + block_rows + batch; }
  __host__ __device__ static int lag_rows(int length) { return lag_before + length + own; }
  static std::size_t bytes(int length, int parts) {
    return sizeof(double) * std::size_t(lanes * (y_rows(length, warps / parts * own) + lag_rows(length)));
  }

  __device__ static void convolve(const Share& s, double* shared, const double* y, double* v) {
    const int block_oldest = s.first - s.length, oldest = s.j - s.length;
    const int count = y_rows(s.length, s.block_rows()), lags = lag_rows(s.length);
    double *const values = shared + s.lane, *const weights = values + count * lanes;
    const double* const column = y + (s.given ? s.l : 0);
    for (int i = s.warp; i < lags; i += warps)
      __pipeline_memcpy_async(weights + i * lanes, s.weights.W + long(i - lag_before) * s.weights.stride + s.l,
                              sizeof(double));
    await_previous();
    for (int i = s.warp; i < count; i += warps) {
      const int row = block_oldest + i;
      const bool there = row >= 1 && row < s.rows;
      __pipeline_memcpy_async(values + i * lanes, column + long(there ? row : 0) * s.step, sizeof(double),
                              there ? 0 : sizeof(double));
    }
    __pipeline_commit();
    __pipeline_wait_prior(0);
    __syncthreads();
    const int portion = s.portion(oldest), from = oldest + s.part * portion, batches = s.batches(from, portion);
    const double* value = values + (from - block_oldest) * lanes;
    const double* weight = weights + (s.j - from + lag_before) * lanes;
    double sum[own] = {}, w[own];
    if (batches > 0) {
#pragma unroll
      for (int g = 0; g < own; ++g) w[g] = weight[g * lanes];
    }
    for (int at = 0; at < batches; ++at, value += batch * lanes, weight -= batch * lanes)
      add_batch(value, lanes, weight - lanes, -lanes, w, sum);
    s.put(sum, shared, y, v);
  }
};

/// Long memory: each thread prefetches `stages` batches of its rows of y and their weights into shared memory. Threads
/// read only their own copies.
struct Far {
  static constexpr int stages = 3, threads = lanes * warps;
  static constexpr std::size_t bytes = sizeof(double) * 2 * batch * stages * threads;

  __device__ static void convolve(const Share& s, double* shared, const double* y, double* v) {
    await_previous();
    const int oldest = max(1, s.j - s.length), portion = s.portion(oldest);
    const int from = oldest + s.part * portion, batches = s.batches(from, portion);
    const double* const column = y + (s.given ? s.l : 0);
    const double* weight = s.weights.W + s.l + long(s.j - from - 1) * s.weights.stride;
    const auto of_stage = [&](int stage) { return shared + (stage * 2 * batch * warps + s.warp) * lanes + s.lane; };
    int row = from;
    const auto copy = [&](int stage) {
      double* const to = of_stage(stage);
#pragma unroll
      for (int c = 0; c < batch; ++c, weight -= s.weights.stride) {
        __pipeline_memcpy_async(to + 2 * c * threads, column + long(min(row + c, s.rows - 1)) * s.step, sizeof(double));
        __pipeline_memcpy_async(to + (2 * c + 1) * threads, weight, sizeof(double));
      }
      row += batch;
    };
#pragma unroll
    for (int stage = 0; stage + 1 < stages; ++stage) {
      if (stage < batches) copy(stage);
      __pipeline_commit();
    }
    double sum[own] = {}, w[own];
    if (batches > 0) {
#pragma unroll
      for (int g = 0; g < own; ++g) w[g] = s.weights.W[long(s.j + g - from) * s.weights.stride + s.l];
    }
    for (int at = 0, stage = 0; at < batches; ++at, stage = stage + 1 < stages ? stage + 1 : 0) {
      __pipeline_wait_prior(stages - 2);
      const double* const read = of_stage(stage);
      add_batch(read, 2 * threads, read + threads, 2 * threads, w, sum);
      if (at + stages - 1 < batches) copy(stage > 0 ? stage - 1 : stages - 1);
      __pipeline_commit();
    }
    s.put(sum, shared, y, v);
  }
};

// Longest memory first, and within it the latest rows, for load balance.
__global__ void __launch_bounds__(lanes* warps, 3) convolve(Weights weights, Lengths lengths, int step, int begin,
                                                            int rows, const double* y, double* v, bool overlapped) {
  extern __shared__ double shared[];
  if (overlapped) let_next_begin();
  const int length = lengths.of[min(int(blockIdx.y), most_groups - 1)], parts = lengths.parts(length);
  const int first = begin + int(gridDim.x - 1 - blockIdx.x) * (warps / parts) * own;
  if (first >= rows) return;
  const Share share{weights, length, parts, step, first, rows};
  if (length <= lengths.near)
    Near::convolve(share, shared, y, v);
  else
    Far::convolve(share, shared, y, v);
}

class DirectConvolution final : public Convolution {
 public:
  DirectConvolution(const Device& device, cudaStream_t stream, const ModalRecurrence& r,
                    const std::vector<Index>& lengths, Index begin, Index rows)
      : device_(device),
        stream_(stream),
        first_(begin),
        total_(r.modes()),
        n_(total_ - begin),
        stride_((n_ + lanes - 1) / lanes * lanes),
        rows_(rows),
        lengths_(of_groups(device, lengths)),
        W_(device, std::size_t((before + lengths_.longest + 1 + beyond) * stride_)),
        S_(device, std::size_t((lengths_.longest + 1) * stride_)) {
    W_.clear();
    const Index K = r.exponentials();
    RowMatrix tables(3 * K + 3, n_);  // a single copy
    tables << r.decay.rightCols(n_), r.output.rightCols(n_), r.start.rightCols(n_), r.w0.tail(n_).transpose(),
        r.w1.tail(n_).transpose(), r.s1.tail(n_).transpose();
    const Memory<double> sent = on_device(device, tables);
    const double *const decay = sent.data(), *const w0 = decay + 3 * K * n_;
    const Exponentials e{decay, decay + K * n_, decay + 2 * K * n_, w0, w0 + n_, w0 + 2 * n_, int(K), int(n_)};
    const dim3 blocks(unsigned((n_ + 127) / 128), unsigned((lengths_.longest + lags) / lags));
    form_weights<<<blocks, 128, 0, device.stream()>>>(e, lengths_.longest + 1, int(stride_),
                                                      W_.data() + before * stride_, S_.data());
    check(cudaGetLastError(), "forming weights");
    device.wait();  // kernels may read them before their predecessors end (launch.cuh)
    check(cudaFuncSetAttribute(convolve, cudaFuncAttributeMaxDynamicSharedMemorySize,
                               int(std::max(Near::bytes(lengths_.near, 1), Far::bytes))),
          "reserving shared memory");
  }

  void apply(const Array& y, Array& v, Index first) override {
    if (rows_ < 2)
      check(cudaMemsetAsync(values(v) + first_, 0, sizeof(double) * std::size_t(n_), stream_), "clearing a row");
    else
      start(int(first), values(y) + first_, values(v) + first_);
  }

  std::size_t bytes() const override { return W_.bytes() + S_.bytes(); }

 private:
  Lengths of_groups(const Device& device, const std::vector<Index>& lengths) const {
    const Index blocks = stride_ / lanes * (rows_ / (warps * own));
    Lengths groups{{}, 1, blocks < 2 * device.multiprocessors() ? few_alone : many_alone, most_near};
    while (Near::bytes(groups.near, 1) > device.shared_memory()) groups.near /= 2;
    for (Index l = 0; l < n_; ++l) {
      const int length = int(lengths[std::size_t(first_ + l)]);
      int& group = groups.of[std::min<Index>(l / lanes, most_groups - 1)];
      group = std::max({group, length, 1});
      groups.longest = std::max(groups.longest, group);
    }
    return groups;
  }

  // Bytes that a block needs for near groups, for far groups, and for adding up its parts.
  std::size_t shared_bytes() const {
    std::size_t most = sizeof(double) * warps * own * lanes;
    for (const int length : lengths_.of)
      if (length > 0)
        most = std::max(most, length <= lengths_.near ? Near::bytes(length, lengths_.parts(length)) : Far::bytes);
    return most;
  }

  // Computes rows max(1, first) .. rows - 1 of v.
  void start(int first, const double* y, double* v) {
    const int begin = std::max(first, 1), rows = int(rows_), tiles = (rows - begin + own - 1) / own;
    if (tiles <= 0) return;
    const int along = warps / lengths_.parts(lengths_.longest);  // smallest number of tiles per block
    const dim3 blocks(unsigned((tiles + along - 1) / along), unsigned(stride_ / lanes));
    const Weights weights{W_.data() + before * stride_, S_.data(), int(n_), int(stride_)};
    const dim3 threads(lanes, warps);
    const int step = int(stride(total_));
    const bool few = blocks.x * blocks.y <= unsigned(few_blocks * device_.multiprocessors());
    if (few && stream_ == device_.stream())
      return follow(device_, convolve, {blocks, threads, shared_bytes()}, "starting a convolution", weights, lengths_,
                    step, begin, rows, y, v, true);
    convolve<<<blocks, threads, shared_bytes(), stream_>>>(weights, lengths_, step, begin, rows, y, v, false);
    check(cudaGetLastError(), "starting a convolution");
  }

  const Device& device_;
  cudaStream_t stream_;
  Index first_, total_, n_, stride_, rows_;  ///< this plan computes modes first_ .. total_ - 1
  Lengths lengths_;
  Memory<double> W_, S_;
};

}  // namespace

std::unique_ptr<Convolution> make_direct_convolution(const Device& device, cudaStream_t stream,
                                                     const ModalRecurrence& r, const std::vector<Index>& lengths,
                                                     Index first, Index rows) {
  return std::make_unique<DirectConvolution>(device, stream, r, lengths, first, rows);
}

}  // namespace bromwich::cuda

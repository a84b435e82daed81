// Causal convolution along time as a recurrence with K exponentials a mode (core/recurrence.hpp), in chunks of time:
// (1) accumulate: the state that each chunk adds, from zero; (2) carry: z at the start of chunk c+1 = E^length z at the
// start of c + what c adds; (3) apply. What chunks add and start from is kept, so a later call can begin at any chunk
// whose past has not changed. Where the chunks are few, the third pass carries for itself.
//
// Few rows take the weights themselves (convolution_direct.cu).
//
// A block takes 32 neighbouring modes and a chunk; its threads have `group` exponentials of one mode each, with their
// states in registers. The rows of y come to shared memory in tiles, two ahead of the one in work; the warps add up
// their outputs there, with one barrier a tile. Three multiply-adds a value and exponential.

#include "kernels/parts.hpp"

#include <cuda_pipeline_primitives.h>

#include <algorithm>
#include <cmath>

namespace bromwich::cuda {

namespace {

constexpr int lanes = 32, group = 8, tile = 16;
constexpr int most_warps = 8;         ///< of a block; more exponentials are taken in slabs
constexpr Index most_chunks = 65535;  ///< of a grid of blocks in its second direction
constexpr Index most_direct = 513;    ///< rows whose weights are summed as they are
constexpr double cheap_carry = 8e6;   ///< bytes read for carrying without a pass of its own

/// K x n tables with the mode index contiguous, K a multiple of `group`, n of `lanes`.
struct Tables {
  const double *decay, *power, *output, *start, *initial, *w0, *w1, *s1;
  int exponentials, modes, stride;  ///< stride = padded n
  int step;                         ///< of y and v, from row to row
};

struct Span {
  int from, chunks, length, rows;  ///< chunks from .. chunks-1 of `length` rows each, beginning at row 1
  __device__ int begin(int c) const { return 1 + c * length; }
  __device__ int end(int c) const { return min(rows, 1 + (c + 1) * length); }
};

/// The rows of a chunk for the modes of a block, tile by tile, each with the row before it; zeros beyond the rows of y.
class Tiles {
 public:
  static constexpr int stages = 4, size = stages * (tile + 1) * lanes;

  /// Begins to fetch the first tiles. Rows and modes beyond those of y are clamped to its last ones.
  __device__ Tiles(double* shared, const Tables& m, const double* y, int begin, int end)
      : shared_(shared),
        y_(y + min(int(blockIdx.x) * lanes + int(threadIdx.x), m.modes - 1)),
        step_(m.step),
        begin_(begin),
        end_(end) {
    for (int t = 0; t + 1 < stages; ++t) fetch(t);
  }

  /// Tile t, after t + 2 has been asked for, once it is there for all threads of the block; [row + 1][lane], row -1
  /// being the one before.
  __device__ const double* wait(int t) {
    __pipeline_wait_prior(1);
    __syncthreads();
    return stage(t);
  }
  /// Begins to fetch tile t, in the place of tile t - 4, which nobody may be reading any more.
  __device__ void fetch(int t) {
    const int first = begin_ + t * tile - 1;
    if (first + 1 < end_)
      for (int i = threadIdx.y; i <= tile; i += blockDim.y)
        __pipeline_memcpy_async(stage(t) + i * lanes + threadIdx.x, y_ + long(min(first + i, end_ - 1)) * step_, 8);
    __pipeline_commit();
  }

 private:
  __device__ double* stage(int t) const { return shared_ + t % stages * (tile + 1) * lanes; }

  double* shared_;
  const double* y_;
  int step_, begin_, end_;
};

// z of one chunk from zero, into added[c]. Chunks that are followed by another one are full.
__global__ void __launch_bounds__(lanes* most_warps)
    accumulate(Tables m, Span span, const double* __restrict__ y, double* __restrict__ added) {
  __shared__ double shared[Tiles::size];
  const int lane = threadIdx.x, l = blockIdx.x * lanes + lane, c = span.from + blockIdx.y;
  const int k0 = (blockIdx.z * blockDim.y + threadIdx.y) * group;
  const bool mine = k0 < m.exponentials;  // the last slab may be a short one
  Tiles tiles(shared, m, y, span.begin(c), span.end(c));
  double E[group], z[group];
#pragma unroll
  for (int g = 0; g < group; ++g) {
    E[g] = mine ? __ldg(m.decay + (k0 + g) * m.stride + l) : 0;
    z[g] = 0;
  }
  for (int t = 0; t < span.length / tile; ++t) {
    const double* const u = tiles.wait(t) + lanes + lane;
    tiles.fetch(t + 3);
#pragma unroll
    for (int i = 0; i < tile; ++i)
#pragma unroll
      for (int g = 0; g < group; ++g) z[g] = E[g] * z[g] + u[i * lanes];
  }
  if (!mine) return;
#pragma unroll
  for (int g = 0; g < group; ++g) added[(long(c) * m.exponentials + k0 + g) * m.stride + l] = z[g];
}

__device__ double state_at_start(const Tables& m, long at, double y0) { return m.start[at] * y0 + m.initial[at]; }

__global__ void carry(Tables m, Span span, const double* __restrict__ y, const double* __restrict__ added,
                      double* __restrict__ states) {
  const int l = blockIdx.x * blockDim.x + threadIdx.x, k = blockIdx.y;
  if (l >= m.modes) return;
  const long at = long(k) * m.stride + l, step = long(m.exponentials) * m.stride;
  double z = span.from == 0 ? state_at_start(m, at, y[l]) : states[span.from * step + at];
  if (span.from == 0) states[at] = z;
  const double power = m.power[at];
#pragma unroll 16
  for (int c = span.from; c + 1 < span.chunks; ++c) {
    z = power * z + added[c * step + at];
    states[(c + 1) * step + at] = z;
  }
}

// z at the start of chunk c; without `states`, from what all chunks before have added.
__device__ double state_of_chunk(const Tables& m, int c, long at, double y0, const double* added,
                                 const double* states) {
  const long step = long(m.exponentials) * m.stride;
  if (states) return states[c * step + at];
  double z = state_at_start(m, at, y0);
  const double power = m.power[at];
#pragma unroll 4
  for (int before = 0; before < c; ++before) z = power * z + added[before * step + at];
  return z;
}

// Exponentials from slab * most_warps * group on; the first slab writes v, the others add to it.
__global__ void __launch_bounds__(lanes* most_warps, 2)
    apply_chunks(Tables m, Span span, int slab, const double* __restrict__ y, const double* __restrict__ added,
                 const double* __restrict__ states, double* __restrict__ v) {
  extern __shared__ double shared[];
  double* const parts = shared + Tiles::size;  // two of [warp][row][lane]
  const int lane = threadIdx.x, warp = threadIdx.y, warps = blockDim.y, c = span.from + blockIdx.y;
  const bool given = int(blockIdx.x) * lanes + lane < m.modes;
  const int l = given ? blockIdx.x * lanes + lane : 0, begin = span.begin(c), end = span.end(c);
  const long at = long(slab * most_warps + warp) * group * m.stride + blockIdx.x * lanes + lane;
  Tiles tiles(shared, m, y, begin, end);
  double z[group];
#pragma unroll
  for (int g = 0; g < group; ++g) z[g] = state_of_chunk(m, c, at + g * m.stride, y[l], added, states);
  const double w0 = m.w0[l], w1 = m.w1[l];
  if (c == 0 && slab == 0 && warp == 0 && given) v[l] = 0;
  const double* u = tiles.wait(0);
  for (int t = 0; begin + t * tile < end; ++t) {
    double sum[tile];
#pragma unroll
    for (int i = 0; i < tile; ++i) sum[i] = 0;
#pragma unroll
    for (int g = 0; g < group; ++g) {
      const double E = __ldg(m.decay + at + g * m.stride), C = __ldg(m.output + at + g * m.stride);
#pragma unroll
      for (int i = 0; i < tile; ++i) {
        sum[i] += C * z[g];
        z[g] = E * z[g] + u[(i + 1) * lanes + lane];
      }
    }
    double* const part = parts + t % 2 * warps * tile * lanes;
#pragma unroll
    for (int i = 0; i < tile; ++i) part[(warp * tile + i) * lanes + lane] = sum[i];
    const double* const next = tiles.wait(t + 1);
    tiles.fetch(t + 3);
    for (int i = warp; i < tile; i += warps) {
      const int j = begin + t * tile + i;
      if (j >= end || !given) break;
      double* const out = v + long(j) * m.step + l;
      const double *now = u + (i + 1) * lanes + lane, *before = now - lanes;
      double all = slab > 0 ? *out : w0 * *now + (j == 1 ? m.s1[l] : w1) * *before;
      for (int other = 0; other < warps; ++other) all += part[(other * tile + i) * lanes + lane];
      *out = all;
    }
    u = next;
  }
}

/// K x n to a table padded with zeros.
Memory<double> padded(const Device& device, const RowMatrix& values, Index K, Index stride) {
  RowMatrix all = RowMatrix::Zero(K, stride);
  if (values.size() > 0) all.topLeftCorner(values.rows(), values.cols()) = values;
  return on_device(device, all);
}

Index rounded_up(Index n, Index to) { return (n + to - 1) / to * to; }

class ModalScan final : public Convolution {
 public:
  ModalScan(const Device& device, const ModalRecurrence& r, Index rows)
      : device_(device),
        n_(r.modes()),
        K_(rounded_up(std::max<Index>(r.exponentials(), 1), group)),
        stride_(rounded_up(n_, lanes)),
        length_(chunk_length(rows)),
        chunks_(std::max<Index>(1, (rows - 1 + length_ - 1) / length_)),
        rows_(rows),
        carries_(0.5 * double(chunks_ * chunks_ * K_ * stride_) * sizeof(double) > cheap_carry),
        decay_(padded(device, r.decay, K_, stride_)),
        power_(padded(device, r.decay.array().pow(double(length_)).matrix(), K_, stride_)),
        output_(padded(device, r.output, K_, stride_)),
        start_(padded(device, r.start, K_, stride_)),
        initial_(padded(device, r.initial, K_, stride_)),
        w0_(on_device(device, r.w0)),
        w1_(on_device(device, r.w1)),
        s1_(on_device(device, r.s1)),
        states_(device, carries_ ? std::size_t(chunks_ * K_ * stride_) : 0),
        added_(device, std::size_t(chunks_ * K_ * stride_)) {}

  void apply(const Array& y, Array& v, Index first) override {
    const cudaStream_t stream = device_.stream();
    const Index from = std::max<Index>(first - 1, 0) / length_;
    if (rows_ < 2) check(cudaMemsetAsync(values(v), 0, sizeof(double) * std::size_t(n_), stream), "clearing a row");
    if (rows_ < 2 || from >= chunks_) return;
    const Tables m{decay_.data(), power_.data(), output_.data(), start_.data(), initial_.data(), w0_.data(),
                   w1_.data(),    s1_.data(),    int(K_),        int(n_),       int(stride_),    int(stride(n_))};
    const Span span{int(from), int(chunks_), int(length_), int(rows_)};
    const unsigned across = unsigned(stride_ / lanes), along = unsigned(chunks_ - from);
    if (along > 1)
      accumulate<<<dim3(across, along - 1, unsigned(slabs())), dim3(lanes, warps(0)), 0, stream>>>(m, span, values(y),
                                                                                                   added_.data());
    if (carries_)
      carry<<<dim3(unsigned((n_ + 127) / 128), unsigned(K_)), 128, 0, stream>>>(m, span, values(y), added_.data(),
                                                                                states_.data());
    for (Index slab = 0; slab < slabs(); ++slab)
      apply_chunks<<<dim3(across, along), dim3(lanes, warps(slab)), shared_bytes(warps(slab)), stream>>>(
          m, span, int(slab), values(y), added_.data(), states_.data(), values(v));
    check(cudaGetLastError(), "starting the scan");
  }

  std::size_t bytes() const override { return 5 * decay_.bytes() + 3 * w0_.bytes() + states_.bytes() + added_.bytes(); }

 private:
  Index slabs() const { return (K_ / group + most_warps - 1) / most_warps; }
  unsigned warps(Index slab) const { return unsigned(std::min<Index>(K_ / group - slab * most_warps, most_warps)); }
  static std::size_t shared_bytes(unsigned warps) {
    return sizeof(double) * std::size_t(Tiles::size + 2 * int(warps) * tile * lanes);
  }

  // As many blocks as the device holds at once, chunks long enough that carrying them costs little.
  Index chunk_length(Index rows) const {
    int blocks = 1;
    check(
        cudaFuncSetAttribute(apply_chunks, cudaFuncAttributeMaxDynamicSharedMemorySize, int(shared_bytes(most_warps))),
        "reserving shared memory");
    check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&blocks, apply_chunks, int(lanes * warps(0)),
                                                        shared_bytes(warps(0))),
          "asking for the occupancy");
    const Index chunks = std::max<Index>(1, Index(blocks) * device_.multiprocessors() * lanes / stride_);
    const Index longest = std::max<Index>(16 * tile, rows / most_chunks + 1);
    return rounded_up(std::clamp<Index>((rows + chunks - 1) / chunks, tile, longest), tile);
  }

  const Device& device_;
  Index n_, K_, stride_, length_, chunks_, rows_;
  bool carries_;  ///< in a pass of its own
  Memory<double> decay_, power_, output_, start_, initial_, w0_, w1_, s1_, states_, added_;
};

}  // namespace

std::unique_ptr<Convolution> make_scan(const Device& device, const ModalRecurrence& r, Index rows) {
  if (rows <= most_direct && r.initial.size() == 0) return make_direct_convolution(device, r, rows);
  return std::make_unique<ModalScan>(device, r, rows);
}

}  // namespace bromwich::cuda

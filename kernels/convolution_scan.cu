// Causal convolution along time as a recurrence with K exponentials a mode (core/recurrence.hpp), in chunks of time:
// (1) accumulate: the state that each chunk adds, from zero; (2) carry: z at the start of chunk c+1 = E^length z at the
// start of c + what c adds; (3) apply. What chunks add and start from is kept, so a later call can begin at any chunk
// whose past has not changed.
//
// Warps work alone, each on 32 neighbouring modes and a chunk, a tile of rows of y in registers at a time. What is
// accumulated is shared out once more, `group` exponentials a warp. Three multiply-adds a value and exponential.

#include "kernels/parts.hpp"

#include <cuda_pipeline_primitives.h>

#include <algorithm>
#include <cmath>

namespace bromwich::cuda {

namespace {

constexpr int lanes = 32, group = 8, tile = 16;
constexpr int most_groups = 8;                  ///< of a launch; more exponentials are taken in slabs
constexpr int slab_size = most_groups * group;  ///< exponentials
constexpr int together = 4;                     ///< exponentials taken at a time in the third pass
constexpr int chunks_together = 4;              ///< warps of a block of the third pass
constexpr Index wanted_warps = 8;               ///< of a multiprocessor in the third pass
constexpr Index most_chunks = 128;              ///< carried one after the other
constexpr int carried = 32;                     ///< chunks that are read at a time

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

/// Rows j .. j + tile - 1 of one mode; rows beyond the last are it again.
__device__ void read_tile(const double* column, int step, int j, int rows, double (&u)[tile]) {
#pragma unroll
  for (int i = 0; i < tile; ++i) u[i] = column[long(min(j + i, rows - 1)) * step];
}

// z of one chunk from zero, into added[c]. Chunks that are followed by another one are full.
__global__ void __launch_bounds__(lanes* most_groups)
    accumulate(Tables m, Span span, const double* __restrict__ y, double* __restrict__ added) {
  const int l = int(blockIdx.x) * lanes + int(threadIdx.x), c = span.from + int(blockIdx.y);
  const int k0 = int(blockIdx.z * blockDim.y + threadIdx.y) * group;
  if (k0 >= m.exponentials) return;
  const double* const column = y + min(l, m.modes - 1);
  const int begin = span.begin(c), end = span.end(c);
  double E[group], z[group], u[tile], next[tile];
#pragma unroll
  for (int g = 0; g < group; ++g) {
    E[g] = __ldg(m.decay + (k0 + g) * m.stride + l);
    z[g] = 0;
  }
  read_tile(column, m.step, begin, span.rows, next);
  for (int j = begin; j < end; j += tile) {
#pragma unroll
    for (int i = 0; i < tile; ++i) u[i] = next[i];
    if (j + tile < end) read_tile(column, m.step, j + tile, span.rows, next);
#pragma unroll
    for (int i = 0; i < tile; ++i)
#pragma unroll
      for (int g = 0; g < group; ++g) z[g] = E[g] * z[g] + u[i];
  }
#pragma unroll
  for (int g = 0; g < group; ++g) added[(long(c) * m.exponentials + k0 + g) * m.stride + l] = z[g];
}

__global__ void carry(Tables m, Span span, const double* __restrict__ y, const double* __restrict__ added,
                      double* __restrict__ states) {
  const int l = int(blockIdx.x) * int(blockDim.x) + int(threadIdx.x), k = int(blockIdx.y);
  if (l >= m.modes) return;
  const long at = long(k) * m.stride + l, step = long(m.exponentials) * m.stride;
  double z = span.from == 0 ? m.start[at] * y[l] + m.initial[at] : states[span.from * step + at];
  if (span.from == 0) states[at] = z;
  const double power = m.power[at];
  for (int c = span.from; c + 1 < span.chunks; c += carried) {
    double of_chunk[carried];
#pragma unroll
    for (int i = 0; i < carried; ++i) of_chunk[i] = c + i + 1 < span.chunks ? added[(c + i) * step + at] : 0;
#pragma unroll
    for (int i = 0; i < carried; ++i) {
      z = power * z + of_chunk[i];
      if (c + i + 1 < span.chunks) states[(c + i + 1) * step + at] = z;
    }
  }
}

/// What the third pass keeps in shared memory, [k][lane] each: the decays and outputs that its chunks have in common,
/// and the states of each chunk.
struct Slab {
  double *decay, *output, *states;
  __device__ Slab(double* shared, int count)
      : decay(shared + threadIdx.x),
        output(decay + count * lanes),
        states(output + (1 + int(threadIdx.y)) * count * lanes) {}
  static std::size_t bytes(Index count) { return sizeof(double) * std::size_t((2 + chunks_together) * count * lanes); }
};

// Exponentials from slab * slab_size on; the first slab writes v, the others add to it.
__global__ void __launch_bounds__(lanes* chunks_together)
    apply_chunks(Tables m, Span span, int slab, const double* __restrict__ y, const double* __restrict__ states,
                 double* __restrict__ v) {
  extern __shared__ double shared[];
  const int warp = int(threadIdx.y), l = int(blockIdx.x) * lanes + int(threadIdx.x);
  const int c = span.from + int(blockIdx.y) * chunks_together + warp;
  const int first = slab * slab_size, count = min(slab_size, m.exponentials - first);
  const Slab own(shared, count);
  const long at = long(first) * m.stride + l, of_chunk = long(c) * m.exponentials * m.stride + at;
  for (int k = 0; k < count; ++k) {
    if (k % chunks_together == warp) {
      __pipeline_memcpy_async(own.decay + k * lanes, m.decay + at + k * m.stride, 8);
      __pipeline_memcpy_async(own.output + k * lanes, m.output + at + k * m.stride, 8);
    }
    if (c < span.chunks) __pipeline_memcpy_async(own.states + k * lanes, states + of_chunk + k * m.stride, 8);
  }
  __pipeline_commit();
  const bool given = l < m.modes;
  const double* const column = y + (given ? l : 0);
  double* const out = v + (given ? l : 0);
  const int begin = span.begin(c), end = c < span.chunks ? span.end(c) : begin;
  if (c == 0 && slab == 0 && given) out[0] = 0;
  const double w0 = given ? m.w0[l] : 0, w1 = given ? m.w1[l] : 0, s1 = given ? m.s1[l] : 0;
  double before = column[long(min(begin, span.rows) - 1) * m.step];
  double u[tile];
  read_tile(column, m.step, begin, span.rows, u);
  __pipeline_wait_prior(0);
  __syncthreads();
  for (int j = begin; j < end; j += tile) {
    double even[tile], odd[tile];
#pragma unroll
    for (int i = 0; i < tile; ++i) {
      even[i] = slab > 0 ? out[long(min(j + i, span.rows - 1)) * m.step] : w0 * u[i];
      odd[i] = slab > 0 ? 0 : (i == 0 && j == 1 ? s1 : w1) * (i > 0 ? u[i > 0 ? i - 1 : 0] : before);
    }
#pragma unroll 1
    for (int k = 0; k < count; k += together) {
      double E[together], C[together], z[together];
#pragma unroll
      for (int g = 0; g < together; ++g) {
        E[g] = own.decay[(k + g) * lanes], C[g] = own.output[(k + g) * lanes];
        z[g] = own.states[(k + g) * lanes];
      }
#pragma unroll
      for (int i = 0; i < tile; ++i)
#pragma unroll
        for (int g = 0; g < together; ++g) {
          (g % 2 == 0 ? even[i] : odd[i]) += C[g] * z[g];
          z[g] = E[g] * z[g] + u[i];
        }
#pragma unroll
      for (int g = 0; g < together; ++g) own.states[(k + g) * lanes] = z[g];
    }
    before = u[tile - 1];
    if (j + tile < end) read_tile(column, m.step, j + tile, span.rows, u);
#pragma unroll
    for (int i = 0; i < tile; ++i)
      if (given && j + i < end) out[long(j + i) * m.step] = even[i] + odd[i];
  }
}

/// The first n columns to a K x stride table padded with zeros.
Memory<double> padded(const Device& device, const RowMatrix& values, Index n, Index K, Index stride) {
  RowMatrix all = RowMatrix::Zero(K, stride);
  if (values.size() > 0) all.topLeftCorner(values.rows(), n) = values.leftCols(n);
  return on_device(device, all);
}

Index rounded_up(Index n, Index to) { return (n + to - 1) / to * to; }

class ModalScan final : public Convolution {
 public:
  ModalScan(const Device& device, const ModalRecurrence& r, Index modes, Index rows)
      : device_(device),
        total_(r.modes()),
        n_(modes),
        K_(rounded_up(std::max<Index>(r.exponentials(), 1), group)),
        stride_(rounded_up(n_, lanes)),
        length_(chunk_length(rows)),
        chunks_(std::max<Index>(1, (rows - 1 + length_ - 1) / length_)),
        rows_(rows),
        decay_(padded(device, r.decay, n_, K_, stride_)),
        power_(padded(device, r.decay.array().pow(double(length_)).matrix(), n_, K_, stride_)),
        output_(padded(device, r.output, n_, K_, stride_)),
        start_(padded(device, r.start, n_, K_, stride_)),
        initial_(padded(device, r.initial, n_, K_, stride_)),
        w0_(on_device(device, r.w0)),
        w1_(on_device(device, r.w1)),
        s1_(on_device(device, r.s1)),
        states_(device, std::size_t(chunks_ * K_ * stride_)),
        added_(device, std::size_t(chunks_ * K_ * stride_)) {
    check(cudaFuncSetAttribute(apply_chunks, cudaFuncAttributeMaxDynamicSharedMemorySize, int(Slab::bytes(slab_size))),
          "reserving shared memory");
  }

  void apply(const Array& y, Array& v, Index first) override {
    const cudaStream_t stream = device_.stream();
    const Index from = std::max<Index>(first - 1, 0) / length_;
    if (rows_ < 2) check(cudaMemsetAsync(values(v), 0, sizeof(double) * std::size_t(n_), stream), "clearing a row");
    if (rows_ < 2 || from >= chunks_) return;
    const Tables m{decay_.data(), power_.data(), output_.data(), start_.data(), initial_.data(), w0_.data(),
                   w1_.data(),    s1_.data(),    int(K_),        int(n_),       int(stride_),    int(stride(total_))};
    const Span span{int(from), int(chunks_), int(length_), int(rows_)};
    const unsigned across = unsigned(stride_ / lanes), along = unsigned(chunks_ - from);
    const unsigned groups = unsigned(std::min<Index>(K_ / group, most_groups)),
                   slabs = unsigned(rounded_up(K_, slab_size) / slab_size);
    if (along > 1)
      accumulate<<<dim3(across, along - 1, slabs), dim3(lanes, groups), 0, stream>>>(m, span, values(y), added_.data());
    carry<<<dim3(unsigned((n_ + 127) / 128), unsigned(K_)), 128, 0, stream>>>(m, span, values(y), added_.data(),
                                                                              states_.data());
    const dim3 blocks(across, (along + chunks_together - 1) / chunks_together), threads(lanes, chunks_together);
    for (unsigned slab = 0; slab < slabs; ++slab)
      apply_chunks<<<blocks, threads, Slab::bytes(std::min<Index>(K_ - slab * slab_size, slab_size)), stream>>>(
          m, span, int(slab), values(y), states_.data(), values(v));
    check(cudaGetLastError(), "starting the scan");
  }

  std::size_t bytes() const override { return 5 * decay_.bytes() + 3 * w0_.bytes() + states_.bytes() + added_.bytes(); }

 private:
  // As many warps as hide what they wait for; carrying is cheap where chunks are few.
  Index chunk_length(Index rows) const {
    const Index chunks = std::clamp<Index>(wanted_warps * device_.multiprocessors() * lanes / stride_, 1, most_chunks);
    return rounded_up(std::max<Index>((rows - 1 + chunks - 1) / chunks, 2 * tile), tile);
  }

  const Device& device_;
  Index total_, n_, K_, stride_, length_, chunks_, rows_;  ///< modes 0 .. n_ - 1 are taken
  Memory<double> decay_, power_, output_, start_, initial_, w0_, w1_, s1_, states_, added_;
};

}  // namespace

std::unique_ptr<Convolution> make_modal_scan(const Device& device, const ModalRecurrence& r, Index modes, Index rows) {
  return std::make_unique<ModalScan>(device, r, modes, rows);
}

}  // namespace bromwich::cuda

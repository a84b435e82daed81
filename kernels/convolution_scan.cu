// Causal convolution along time as a recurrence with state z (core/recurrence.hpp), in chunks of time: (1) the state
// that each chunk adds, from zero; (2) carry: z at the start of chunk c+1 = E^length z at the start of c + what c adds;
// (3) apply. States at the starts of chunks are kept, so a later call can begin at any chunk whose past has not
// changed.
//
// Modal: a warp takes 32 neighbouring modes, its threads `group` exponentials of one mode each, in registers; the warps
// of a block share out the exponentials and add up their outputs through shared memory. Three multiply-adds a value and
// exponential.

#include "kernels/parts.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich::cuda {

namespace {

constexpr int lanes = 32, group = 8, tile = 16;
constexpr Index blocks_per_multiprocessor = 6;
constexpr int most_warps = 16;  ///< of a block; more exponentials are taken in slabs

/// K x n tables with the mode index contiguous, K a multiple of `group`, n of `lanes`.
struct Tables {
  const double *decay, *power, *output, *start, *initial, *w0, *w1, *s1;
  int exponentials, modes, stride;  ///< stride = padded n
  int step;                         ///< of y and v, from row to row
};

struct Span {
  int from, chunks, length, rows;  ///< chunks from .. chunks-1 of `length` rows each, beginning at row 1
};

// z of one chunk from zero, into added[c].
__global__ void __launch_bounds__(lanes* most_warps, 2)
    accumulate(Tables m, Span span, const double* __restrict__ y, double* __restrict__ added) {
  const int l = blockIdx.x * lanes + threadIdx.x, c = span.from + blockIdx.y;
  const int k0 = (blockIdx.z * most_warps + threadIdx.y) * group;
  if (l >= m.modes || k0 >= m.exponentials) return;
  double E[group], z[group];
#pragma unroll
  for (int g = 0; g < group; ++g) {
    E[g] = m.decay[(k0 + g) * m.stride + l];
    z[g] = 0;
  }
  const int begin = 1 + c * span.length, end = min(span.rows, begin + span.length);
#pragma unroll 4
  for (int j = begin; j < end; ++j) {
    const double u = y[long(j) * m.step + l];
#pragma unroll
    for (int g = 0; g < group; ++g) z[g] = E[g] * z[g] + u;
  }
#pragma unroll
  for (int g = 0; g < group; ++g) added[(long(c) * m.exponentials + k0 + g) * m.stride + l] = z[g];
}

__global__ void carry(Tables m, Span span, const double* __restrict__ y, const double* __restrict__ added,
                      double* __restrict__ states) {
  const int l = blockIdx.x * blockDim.x + threadIdx.x, k = blockIdx.y;
  if (l >= m.modes) return;
  const long at = long(k) * m.stride + l, step = long(m.exponentials) * m.stride;
  double z = states[span.from * step + at];
  if (span.from == 0) {
    z = m.start[at] * y[l] + m.initial[at];
    states[at] = z;
  }
  const double power = m.power[at];
#pragma unroll 16
  for (int c = span.from; c + 1 < span.chunks; ++c) {
    z = power * z + added[c * step + at];
    states[(c + 1) * step + at] = z;
  }
}

// Exponentials from slab * most_warps * group on; the first slab writes v, the others add to it.
__global__ void __launch_bounds__(lanes* most_warps, 2)
    apply_chunks(Tables m, Span span, int slab, const double* __restrict__ y, const double* __restrict__ states,
                 double* __restrict__ v) {
  extern __shared__ double part[];  // [warp][tile][lane]
  __shared__ double input[tile + 1][lanes];
  const int lane = threadIdx.x, warp = threadIdx.y, warps = blockDim.y;
  const int l = blockIdx.x * lanes + lane, k0 = (slab * most_warps + warp) * group, c = span.from + blockIdx.y;
  const bool given = l < m.modes;
  const int at = given ? l : 0;
  double E[group], C[group], z[group];
#pragma unroll
  for (int g = 0; g < group; ++g) {
    E[g] = m.decay[(k0 + g) * m.stride + at];
    C[g] = m.output[(k0 + g) * m.stride + at];
    z[g] = states[(long(c) * m.exponentials + k0 + g) * m.stride + at];
  }
  const double w0 = m.w0[at], w1 = m.w1[at], s1 = m.s1[at];
  const int begin = 1 + c * span.length, end = min(span.rows, begin + span.length);
  for (int first = begin; first < end; first += tile) {
    const int count = min(tile, end - first);
    for (int i = warp; i <= count; i += warps) input[i][lane] = given ? y[long(first + i - 1) * m.step + l] : 0;
    __syncthreads();
#pragma unroll 4
    for (int i = 0; i < count; ++i) {
      const double u = input[i + 1][lane];
      double sum = 0;
#pragma unroll
      for (int g = 0; g < group; ++g) {
        sum += C[g] * z[g];
        z[g] = E[g] * z[g] + u;
      }
      part[(warp * tile + i) * lanes + lane] = sum;
    }
    __syncthreads();
    for (int i = warp; i < count; i += warps) {
      double* const out = v + long(first + i) * m.step + at;
      double sum = slab > 0 ? *out : w0 * input[i + 1][lane] + (first + i == 1 ? s1 : w1) * input[i][lane];
      for (int other = 0; other < warps; ++other) sum += part[(other * tile + i) * lanes + lane];
      if (given) *out = sum;
    }
    __syncthreads();
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
        decay_(padded(device, r.decay, K_, stride_)),
        power_(padded(device, r.decay.array().pow(double(length_)).matrix(), K_, stride_)),
        output_(padded(device, r.output, K_, stride_)),
        start_(padded(device, r.start, K_, stride_)),
        initial_(padded(device, r.initial, K_, stride_)),
        w0_(on_device(device, r.w0)),
        w1_(on_device(device, r.w1)),
        s1_(on_device(device, r.s1)),
        states_(device, std::size_t(chunks_ * K_ * stride_)),
        added_(device, std::size_t(chunks_ * K_ * stride_)) {
    check(cudaFuncSetAttribute(apply_chunks, cudaFuncAttributeMaxDynamicSharedMemorySize, int(shared_bytes())),
          "reserving shared memory");
  }

  void apply(const Array& y, Array& v, Index first) override {
    const cudaStream_t stream = device_.stream();
    if (first == 0) check(cudaMemsetAsync(values(v), 0, sizeof(double) * std::size_t(n_), stream), "clearing a row");
    const Index from = std::max<Index>(first - 1, 0) / length_;
    if (rows_ < 2 || from >= chunks_) return;
    const Tables m{decay_.data(), power_.data(), output_.data(), start_.data(), initial_.data(), w0_.data(),
                   w1_.data(),    s1_.data(),    int(K_),        int(n_),       int(stride_),    int(stride(n_))};
    const Span span{int(from), int(chunks_), int(length_), int(rows_)};
    const Index groups = K_ / group, slabs = (groups + most_warps - 1) / most_warps;
    const unsigned across = unsigned(stride_ / lanes), along = unsigned(chunks_ - from);
    const dim3 all(lanes, unsigned(std::min<Index>(groups, most_warps)));
    if (along > 1)
      accumulate<<<dim3(across, along - 1, unsigned(slabs)), all, 0, stream>>>(m, span, values(y), added_.data());
    carry<<<dim3(unsigned((n_ + 127) / 128), unsigned(K_)), 128, 0, stream>>>(m, span, values(y), added_.data(),
                                                                              states_.data());
    for (Index slab = 0; slab < slabs; ++slab) {
      const dim3 threads(lanes, unsigned(std::min<Index>(groups - slab * most_warps, most_warps)));
      apply_chunks<<<dim3(across, along), threads, shared_bytes(), stream>>>(m, span, int(slab), values(y),
                                                                             states_.data(), values(v));
    }
    check(cudaGetLastError(), "starting the scan");
  }

  std::size_t bytes() const override { return 5 * decay_.bytes() + 3 * w0_.bytes() + states_.bytes() + added_.bytes(); }

 private:
  // Enough blocks to fill the device, chunks long enough that carrying them costs little.
  Index chunk_length(Index rows) const {
    const Index blocks = blocks_per_multiprocessor * device_.multiprocessors(),
                chunks = std::max<Index>(1, blocks * lanes / stride_);
    return rounded_up(std::clamp<Index>((rows + chunks - 1) / chunks, tile, 8 * tile), tile);
  }
  std::size_t shared_bytes() const {
    return sizeof(double) * std::size_t(std::min<Index>(K_ / group, most_warps) * tile * lanes);
  }

  const Device& device_;
  Index n_, K_, stride_, length_, chunks_, rows_;
  Memory<double> decay_, power_, output_, start_, initial_, w0_, w1_, s1_, states_, added_;
};

// The state of the scene itself as z; a block per chunk, matrices with columns contiguous.
struct Stepped {
  const double *decay, *input, *output, *w0;
  int m, k, n;
  int y_step, v_step;  ///< from row to row
};

// z <- E z + G u over the rows of a chunk; with v, writes C z + W_0 u before each step.
__device__ void step_chunk(const Stepped& s, double* z, double* next, const double* y, double* v, int begin, int end) {
  for (int j = begin; j < end; ++j) {
    const double* u = y + long(j) * s.y_step;
    for (int i = threadIdx.x; v && i < s.n; i += blockDim.x) {
      double sum = 0;
      for (int e = 0; e < s.m; ++e) sum += s.output[e * s.n + i] * z[e];
      for (int e = 0; e < s.k; ++e) sum += s.w0[e * s.n + i] * u[e];
      v[long(j) * s.v_step + i] = sum;
    }
    for (int i = threadIdx.x; i < s.m; i += blockDim.x) {
      double sum = 0;
      for (int e = 0; e < s.m; ++e) sum += s.decay[e * s.m + i] * z[e];
      for (int e = 0; e < s.k; ++e) sum += s.input[e * s.m + i] * u[e];
      next[i] = sum;
    }
    __syncthreads();
    double* const old = z;
    z = next;
    next = old;
  }
  // The caller looks at its own z.
  if ((end - begin) % 2 != 0 && end > begin) {
    for (int i = threadIdx.x; i < s.m; i += blockDim.x) next[i] = z[i];
    __syncthreads();
  }
}

__global__ void accumulate_dense(Stepped s, Span span, const double* y, double* added) {
  extern __shared__ double shared[];
  const int c = span.from + blockIdx.x, begin = 1 + c * span.length;
  for (int i = threadIdx.x; i < s.m; i += blockDim.x) shared[i] = 0;
  __syncthreads();
  step_chunk(s, shared, shared + s.m, y, nullptr, begin, min(span.rows, begin + span.length));
  for (int i = threadIdx.x; i < s.m; i += blockDim.x) added[long(c) * s.m + i] = shared[i];
}

__global__ void carry_dense(Span span, int m, int k, const double* power, const double* start, const double* y,
                            const double* added, double* states) {
  if (span.from == 0)
    for (int i = threadIdx.x; i < m; i += blockDim.x) {
      double sum = 0;
      for (int e = 0; e < k; ++e) sum += start[e * m + i] * y[e];
      states[i] = sum;
    }
  for (int c = span.from; c + 1 < span.chunks; ++c) {
    __syncthreads();
    for (int i = threadIdx.x; i < m; i += blockDim.x) {
      double sum = added[long(c) * m + i];
      for (int e = 0; e < m; ++e) sum += power[e * m + i] * states[long(c) * m + e];
      states[long(c + 1) * m + i] = sum;
    }
  }
}

__global__ void apply_dense(Stepped s, Span span, const double* y, const double* states, double* v) {
  extern __shared__ double shared[];
  const int c = span.from + blockIdx.x, begin = 1 + c * span.length;
  for (int i = threadIdx.x; i < s.m; i += blockDim.x) shared[i] = states[long(c) * s.m + i];
  __syncthreads();
  step_chunk(s, shared, shared + s.m, y, v, begin, min(span.rows, begin + span.length));
}

Matrix power(Matrix base, Index exponent) {
  Matrix result = Matrix::Identity(base.rows(), base.cols());
  for (; exponent > 0; exponent /= 2, base = (base * base).eval())
    if (exponent % 2 != 0) result = (result * base).eval();
  return result;
}

class DenseScan final : public Convolution {
 public:
  DenseScan(const Device& device, const DenseRecurrence& r, Index rows)
      : device_(device),
        m_(r.decay.rows()),
        k_(r.input.cols()),
        n_(r.output.rows()),
        rows_(rows),
        length_(std::clamp<Index>(Index(std::sqrt(double(rows))), 8, 256)),
        chunks_(std::max<Index>(1, (rows - 1 + length_ - 1) / length_)),
        decay_(on_device(device, r.decay)),
        input_(on_device(device, r.input)),
        start_(on_device(device, r.start)),
        output_(on_device(device, r.output)),
        w0_(on_device(device, r.w0)),
        power_(on_device(device, power(r.decay, length_))),
        states_(device, std::size_t(chunks_ * m_)),
        added_(device, std::size_t(chunks_ * m_)) {}

  void apply(const Array& y, Array& v, Index first) override {
    const cudaStream_t stream = device_.stream();
    if (first == 0) check(cudaMemsetAsync(values(v), 0, sizeof(double) * std::size_t(n_), stream), "clearing a row");
    const Index from = std::max<Index>(first - 1, 0) / length_;
    if (rows_ < 2 || from >= chunks_) return;
    const Stepped s{decay_.data(), input_.data(), output_.data(),  w0_.data(),     int(m_),
                    int(k_),       int(n_),       int(stride(k_)), int(stride(n_))};
    const Span span{int(from), int(chunks_), int(length_), int(rows_)};
    const unsigned threads = unsigned(std::clamp<Index>((std::max(m_, n_) + 31) / 32 * 32, 32, 256));
    const std::size_t shared = 2 * sizeof(double) * std::size_t(m_);
    if (chunks_ - from > 1)
      accumulate_dense<<<unsigned(chunks_ - from - 1), threads, shared, stream>>>(s, span, values(y), added_.data());
    carry_dense<<<1, 256, 0, stream>>>(span, int(m_), int(k_), power_.data(), start_.data(), values(y), added_.data(),
                                       states_.data());
    apply_dense<<<unsigned(chunks_ - from), threads, shared, stream>>>(s, span, values(y), states_.data(), values(v));
    check(cudaGetLastError(), "starting the scan");
  }

  std::size_t bytes() const override {
    return decay_.bytes() * 2 + input_.bytes() * 2 + output_.bytes() + w0_.bytes() + 2 * states_.bytes();
  }

 private:
  const Device& device_;
  Index m_, k_, n_, rows_, length_, chunks_;
  Memory<double> decay_, input_, start_, output_, w0_, power_, states_, added_;
};

}  // namespace

std::unique_ptr<Convolution> make_scan(const Device& device, const ModalRecurrence& r, Index rows) {
  return std::make_unique<ModalScan>(device, r, rows);
}

std::unique_ptr<Convolution> make_scan(const Device& device, const DenseRecurrence& r, Index rows) {
  return std::make_unique<DenseScan>(device, r, rows);
}

}  // namespace bromwich::cuda

// Causal convolution along time as a recurrence with a dense state z (core/seam/recurrence.hpp), as a chunked scan like
// convolution_scan.cu: one block per chunk, column-major matrices.

#include "kernels/launch.cuh"
#include "kernels/parts.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich::cuda {

namespace {

struct Span {
  int from, chunks, length, rows;  ///< chunks from .. chunks-1 of `length` rows each, beginning at row 1
};

struct Stepped {
  const double *decay, *input, *output, *w0;
  int m, k, n;
  int y_step, v_step;  ///< between rows
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
  // The caller reads the result from `z`.
  if ((end - begin) % 2 != 0 && end > begin) {
    for (int i = threadIdx.x; i < s.m; i += blockDim.x) next[i] = z[i];
    __syncthreads();
  }
}

__global__ void accumulate_dense(Stepped s, Span span, const double* y, double* added) {
  extern __shared__ double shared[];
  let_next_begin();
  await_previous();
  const int c = span.from + blockIdx.x, begin = 1 + c * span.length;
  for (int i = threadIdx.x; i < s.m; i += blockDim.x) shared[i] = 0;
  __syncthreads();
  step_chunk(s, shared, shared + s.m, y, nullptr, begin, min(span.rows, begin + span.length));
  for (int i = threadIdx.x; i < s.m; i += blockDim.x) added[long(c) * s.m + i] = shared[i];
}

__global__ void carry_dense(Span span, int m, int k, const double* power, const double* start, const double* y,
                            const double* added, double* states) {
  let_next_begin();
  await_previous();
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
  let_next_begin();
  await_previous();
  const int c = span.from + blockIdx.x, begin = 1 + c * span.length;
  for (int i = threadIdx.x; i < s.m; i += blockDim.x) shared[i] = states[long(c) * s.m + i];
  __syncthreads();
  step_chunk(s, shared, shared + s.m, y, v, begin, min(span.rows, begin + span.length));
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
        power_(on_device(device, matrix_power(r.decay, length_))),
        states_(device, std::size_t(chunks_ * m_)),
        added_(device, std::size_t(chunks_ * m_)) {
    for (const void* kernel : {(const void*)accumulate_dense, (const void*)apply_dense})
      check(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, int(device.shared_memory())),
            "reserving shared memory");
  }

  void apply(const Array& y, Array& v, Index first) override {
    if (first == 0)
      check(cudaMemsetAsync(values(v), 0, sizeof(double) * std::size_t(n_), device_.stream()), "clearing a row");
    const Index from = std::max<Index>(first - 1, 0) / length_;
    if (rows_ < 2 || from >= chunks_) return;
    const Stepped s{decay_.data(), input_.data(), output_.data(),  w0_.data(),     int(m_),
                    int(k_),       int(n_),       int(stride(k_)), int(stride(n_))};
    const Span span{int(from), int(chunks_), int(length_), int(rows_)};
    const unsigned threads = unsigned(std::clamp<Index>((std::max(m_, n_) + 31) / 32 * 32, 32, 256));
    const std::size_t shared = 2 * sizeof(double) * std::size_t(m_);
    const char* const what = "starting the scan";
    if (chunks_ - from > 1)
      follow(device_, accumulate_dense, {unsigned(chunks_ - from - 1), threads, shared}, what, s, span, values(y),
             added_.data());
    follow(device_, carry_dense, {1, 256}, what, span, int(m_), int(k_), power_.data(), start_.data(), values(y),
           added_.data(), states_.data());
    follow(device_, apply_dense, {unsigned(chunks_ - from), threads, shared}, what, s, span, values(y), states_.data(),
           values(v));
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

std::unique_ptr<Convolution> make_convolution(const Device& device, const DenseRecurrence& r, Index rows) {
  return std::make_unique<DenseScan>(device, r, rows);
}

}  // namespace bromwich::cuda

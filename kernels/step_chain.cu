// Chains of dense one-step maps (core/host/step_chain.hpp) with up to 64 states. In the direction of the solution, rows
// are row vectors with
//
//     x_p = q_p + x_{p-1} (I + X_p),    X = D^T forward in time, X = D for the adjoint, p = 1..M,
//
// D the increment of the step (core/host/step_chain.hpp); products of steps are also stored as increments. Serial: one
// block, 16 threads per component, with the next map prefetched. Scan: one block per chunk of steps forms the product
// of the maps and its contribution [I + X; x], (m+1) x m values in shared memory; one block carries from chunk to
// chunk; then all chunks are substituted at once. Doubling: the same product for every row, with all products of 2^k
// maps in global memory: 2 M m^2 values read and M m^2 written per level. Repeated windows are not shared: naming them
// on the host takes longer than multiplying them.

#include "kernels/host_plans.hpp"
#include "kernels/parts.hpp"
#include "kernels/step_chain.hpp"

#include "core/base/error.hpp"
#include "core/host/step_chain.hpp"

#include <cuda_pipeline_primitives.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace bromwich::cuda {

namespace {

constexpr Index most_steps = 100'000'000;
constexpr int most_states = 64, lanes = 16, slots = most_states / lanes;
constexpr int threads = 256;
constexpr Index serial_steps = 256;  ///< up to here a scan is no faster

/// Matrices by kind, column-major, and the direction.
struct Chain {
  const double* matrices;
  const int* map_of;  ///< null: step i has matrix i
  int m, M, stride;   ///< stride: between rows
  bool backward;      ///< position p is row M - p
  bool transposed;    ///< X is the transpose of the matrix

  __device__ long row(int p) const { return long(backward ? M - p : p) * stride; }
  __device__ int kind(int p) const {
    const int step = backward ? M - p : p - 1;
    return map_of ? __ldg(map_of + step) : step;
  }
  __device__ const double* matrix(int kind) const { return matrices + long(kind) * m * m; }
  __device__ int at(int k, int j) const { return transposed ? k * m + j : j * m + k; }
};

// out_i = in_i X for rows i >= 1 with the matrix of their step; row 0 is copied.
__global__ void solve_rows(Chain c, const double* __restrict__ in, double* __restrict__ out) {
  const long index = long(blockIdx.x) * threads + threadIdx.x;
  const int i = int(index / c.m), j = int(index % c.m);
  if (i > c.M) return;
  const double* row = in + long(i) * c.stride;
  double sum = i == 0 ? row[j] : 0;
  if (i > 0) {
    const double* X = c.matrix(c.map_of[i - 1]);
    for (int k = 0; k < c.m; ++k) sum += row[k] * __ldg(X + c.at(k, j));
  }
  out[long(i) * c.stride + j] = sum;
}

// out_i = q_i + in_{i+1} (X_{i+1}, or I + X_{i+1}), out_M = q_M.
__global__ void sweep_rows(Chain c, bool plus_identity, const double* __restrict__ q, const double* __restrict__ in,
                           double* __restrict__ out) {
  const long index = long(blockIdx.x) * threads + threadIdx.x;
  const int i = int(index / c.m), j = int(index % c.m);
  if (i > c.M) return;
  double sum = q[long(i) * c.stride + j];
  if (i < c.M) {
    const double *X = c.matrix(c.map_of[i]), *row = in + long(i + 1) * c.stride;
    for (int k = 0; k < c.m; ++k) sum += row[k] * __ldg(X + c.at(k, j));
    if (plus_identity) sum += row[j];
  }
  out[long(i) * c.stride + j] = sum;
}

// r_i = d_i + (R - S) x_i - R (x_i - x_{i-1}), r_0 = d_0 - x_0. `change` holds R - S.
__global__ void residual_rows(Chain R, const double* __restrict__ change, const double* __restrict__ d,
                              const double* __restrict__ x, double* __restrict__ r) {
  const long index = long(blockIdx.x) * threads + threadIdx.x;
  const int i = int(index / R.m), j = int(index % R.m);
  if (i > R.M) return;
  const double* row = x + long(i) * R.stride;
  double sum = d[long(i) * R.stride + j];
  if (i == 0) {
    sum -= row[j];
  } else {
    const double* before = row - R.stride;
    const long at = long(R.map_of[i - 1]) * R.m * R.m;
    for (int k = 0; k < R.m; ++k) {
      const int entry = R.at(k, j);
      sum += row[k] * __ldg(change + at + entry) - (row[k] - before[k]) * __ldg(R.matrices + at + entry);
    }
  }
  r[long(i) * R.stride + j] = sum;
}

// Overwrites q in x with the solution, one chunk per block; `entry` has the row before each chunk.
__global__ void substitute(Chain c, double* __restrict__ x, int length, const double* __restrict__ entry) {
  __shared__ double state[2][most_states];
  const int lane = threadIdx.x % lanes, j = threadIdx.x / lanes;
  const int first = blockIdx.x * length + 1, last = min(c.M, first + length - 1);
  const bool mine = j < c.m;
  if (first > last) return;
  double column[slots], add = 0;
  const auto fetch = [&](int p, int kind) {
    const double* X = c.matrix(kind);
#pragma unroll
    for (int t = 0; t < slots; ++t) {
      const int k = lane + t * lanes;
      column[t] = mine && k < c.m ? __ldg(X + c.at(k, j)) : 0;
    }
    add = mine && lane == 0 ? x[c.row(p) + j] : 0;
  };
  if (mine && lane == 0) state[0][j] = entry ? entry[blockIdx.x * c.m + j] : x[c.row(first - 1) + j];
  fetch(first, c.kind(first));
  int kind = first < last ? c.kind(first + 1) : 0;
  __syncthreads();
  for (int p = first; p <= last; ++p) {
    const double* now = state[(p - first) & 1];
    double sum = add;
#pragma unroll
    for (int t = 0; t < slots; ++t)
      if (t * lanes < c.m) sum += now[min(lane + t * lanes, c.m - 1)] * column[t];
    if (p < last) fetch(p + 1, kind);
    if (p + 1 < last) kind = c.kind(p + 2);
#pragma unroll
    for (int offset = lanes / 2; offset > 0; offset /= 2) sum += __shfl_xor_sync(~0u, sum, offset);
    if (mine && lane == 0) {
      sum += now[j];
      state[(p - first + 1) & 1][j] = sum;
      x[c.row(p) + j] = sum;
    }
    __syncthreads();
  }
}

// Entry o of [left; row] X, (m+1) x m, column-major.
__device__ double product_entry(const double* left, const double* X, int m, int o) {
  const int r = o % (m + 1), j = o / (m + 1);
  double sum = 0;
#pragma unroll 8
  for (int k = 0; k < m; ++k) sum += left[k * (m + 1) + r] * X[j * m + k];
  return sum;
}

// For each chunk the increment of the product of its maps, and in row block + 1 of `sums` the contribution of its own
// q.
__global__ void multiply_chunk(Chain c, const double* __restrict__ q, int length, double* __restrict__ products,
                               double* __restrict__ sums) {
  extern __shared__ double shared[];
  const int m = c.m, size = (m + 1) * m;
  double* const now[2] = {shared, shared + size};
  double* const X[2] = {shared + 2 * size, shared + 2 * size + m * m};
  double* const add[2] = {X[1] + m * m, X[1] + m * m + m};
  const int first = blockIdx.x * length + 1, last = min(c.M, first + length - 1);
  const auto fetch = [&](int p) {
    const double* from = c.matrix(c.kind(p));
    for (int o = threadIdx.x; o < m * m; o += blockDim.x)
      __pipeline_memcpy_async(X[p & 1] + o, from + (c.transposed ? o % m * m + o / m : o), 8);
    for (int j = threadIdx.x; j < m; j += blockDim.x) __pipeline_memcpy_async(add[p & 1] + j, q + c.row(p) + j, 8);
    __pipeline_commit();
  };
  for (int o = threadIdx.x; o < size; o += blockDim.x) now[first & 1][o] = 0;
  if (first <= last) fetch(first);
  for (int p = first; p <= last; ++p) {
    __pipeline_wait_prior(0);
    __syncthreads();  // prefetched and computed values are visible, and the old ones are no longer read
    if (p < last) fetch(p + 1);
    for (int o = threadIdx.x; o < size; o += blockDim.x) {
      const int r = o % (m + 1), j = o / (m + 1);
      const double own = r == m ? add[p & 1][j] : X[p & 1][j * m + r];
      now[(p + 1) & 1][o] = now[p & 1][o] + (own + product_entry(now[p & 1], X[p & 1], m, o));
    }
  }
  __syncthreads();
  const double* result = now[(max(last, first - 1) + 1) & 1];
  for (int o = threadIdx.x; o < size; o += blockDim.x) {
    const int r = o % (m + 1), j = o / (m + 1);
    if (r < m)
      products[(long(blockIdx.x) * m + j) * m + r] = result[o];
    else
      sums[(blockIdx.x + 1) * m + j] = result[o];
  }
}

// With the product I + X_i of the `length` maps from row i + length to row i: next_i = mu_i + mu_{i+length} +
// mu_{i+length} X_i. Products of twice the length: X_{i+length} + X_i + X_{i+length} X_i.
__global__ void double_window_rows(Chain c, int length, const double* __restrict__ mu, double* __restrict__ next,
                                   double* __restrict__ longer) {
  extern __shared__ double shared[];
  const int m = c.m, i = blockIdx.x, size = (m + 1) * m;
  double *const left = shared, *const X = shared + size;
  const auto window = [&](int place) { return c.matrix(c.map_of ? c.map_of[place] : place); };
  const bool goes_on = i + 2 * length <= c.M;
  const double *from = window(i), *later = goes_on ? window(i + length) : nullptr;
  for (int o = threadIdx.x; o < m * m; o += blockDim.x) {
    X[o] = from[o];
    if (goes_on) left[o / m * (m + 1) + o % m] = later[o];
  }
  for (int k = threadIdx.x; k < m; k += blockDim.x) left[k * (m + 1) + m] = mu[long(i + length) * c.stride + k];
  __syncthreads();
  for (int o = threadIdx.x; o < size; o += blockDim.x) {
    const int r = o % (m + 1), j = o / (m + 1);
    if (r == m)
      next[long(i) * c.stride + j] = mu[long(i) * c.stride + j] + (left[o] + product_entry(left, X, m, o));
    else if (goes_on)
      longer[(long(i) * m + j) * m + r] = left[o] + (X[j * m + r] + product_entry(left, X, m, o));
  }
}

std::size_t chunk_bytes(Index m) { return sizeof(double) * std::size_t(2 * ((m + 1) * m + m * m + m)); }

int whole_warps(int count) { return std::min(1024, (count + 31) / 32 * 32); }

class SmallStepChain final : public DeviceStepChain {
 public:
  SmallStepChain(const Device& device, const StepChainProblem& problem)
      : DeviceStepChain(device, problem),
        map_of_(device, problem.map_of.size()),
        D_(device, problem.maps.size() * std::size_t(m_ * m_)),
        inverse_(device, D_.size()),
        R_(device, D_.size()),
        change_(device, D_.size()) {
    const std::vector<int> map_of(problem.map_of.begin(), problem.map_of.end());
    map_of_.put(map_of.data());
    const Index columns = m_ * Index(problem.maps.size());
    Matrix D(m_, columns), inverse(m_, columns), R(m_, columns), change(m_, columns);
    for (std::size_t k = 0; k < problem.maps.size(); ++k) {
      const DenseStep step(problem, Index(k));
      D.middleCols(Index(k) * m_, m_) = step.increment;
      inverse.middleCols(Index(k) * m_, m_) = step.inverse;
      R.middleCols(Index(k) * m_, m_) = step.R;
      change.middleCols(Index(k) * m_, m_) = step.change;
    }
    D_.put(D.data());
    inverse_.put(inverse.data());
    R_.put(R.data());
    change_.put(change.data());
    // A step within a chunk costs about four times a chunk of the carry; all chunks run at once.
    const int resident = device.multiprocessors() * std::max(1, 2048 / whole_warps((m_ + 1) * m_));
    const int chunks = std::clamp(int(2 * std::sqrt(double(M_))), 1, resident);
    length_ = (M_ + chunks - 1) / chunks;
    chunks_ = (M_ + length_ - 1) / length_;
    check(cudaFuncSetAttribute(multiply_chunk, cudaFuncAttributeMaxDynamicSharedMemorySize, int(chunk_bytes(m_))),
          "asking for shared memory");
    check(cudaFuncSetAttribute(double_window_rows, cudaFuncAttributeMaxDynamicSharedMemorySize, int(window_bytes())),
          "asking for shared memory");
  }

  std::size_t bytes() const override {
    return map_of_.bytes() + 4 * D_.bytes() + 2 * mu_.bytes() + products_.bytes() + sums_.bytes() +
           windows_[0].bytes() + windows_[1].bytes();
  }

 private:
  void start(const double* d, double* x) override {
    solve_rows<<<row_blocks(), threads, 0, device_.stream()>>>(chain(inverse_, false, true), d, x);
    check(cudaGetLastError(), "starting the steps");
  }

  void finish(const double* mu, double* l) override {
    solve_rows<<<row_blocks(), threads, 0, device_.stream()>>>(chain(inverse_, true, false), mu, l);
    check(cudaGetLastError(), "starting the adjoint");
  }

  void sweep(const Array& q, const Array& l, Array& z) override {
    sweep_rows<<<row_blocks(), threads, 0, device_.stream()>>>(chain(R_, true, false), false, values(q), values(l),
                                                               values(mu_));
    check(cudaGetLastError(), "starting a sweep");
    finish(values(mu_), values(z));
  }

  void residual(const Array& d, const Array& x, Array& r) override {
    residual_rows<<<row_blocks(), threads, 0, device_.stream()>>>(chain(R_, false, true), change_.data(), values(d),
                                                                  values(x), values(r));
    check(cudaGetLastError(), "starting the residual");
  }

  Chain chain(const Memory<double>& matrices, bool backward, bool transposed) const {
    return {matrices.data(), map_of_.data(), m_, M_, int(stride(m_)), backward, transposed};
  }
  unsigned row_blocks() const { return unsigned((long(M_ + 1) * m_ + threads - 1) / threads); }
  double scan_bytes() const override { return 8.0 * double(chunks_) * double(m_ * m_); }
  std::size_t window_bytes() const { return sizeof(double) * std::size_t((m_ + 1) * m_ + m_ * m_); }

  Chain along(Direction direction) const {
    return direction == Direction::forward ? chain(D_, false, true) : chain(D_, true, false);
  }

  void run(Direction direction, double* x) override {
    substitute<<<1, whole_warps(lanes * m_), 0, device_.stream()>>>(along(direction), x, M_, nullptr);
    check(cudaGetLastError(), "starting the substitution");
  }

  bool scan_is_faster() const override { return M_ > serial_steps; }

  void scan(Direction direction, double* x) override {
    const Chain steps = along(direction);
    if (products_.size() == 0) {
      products_ = Memory<double>(device_, std::size_t(chunks_) * std::size_t(m_ * m_));
      sums_ = Memory<double>(device_, std::size_t(chunks_ + 1) * std::size_t(m_));
    }
    const double* start = x + (steps.backward ? long(M_) * steps.stride : 0);
    check(cudaMemcpyAsync(sums_.data(), start, sizeof(double) * std::size_t(m_), cudaMemcpyDeviceToDevice,
                          device_.stream()),
          "copying rows");
    multiply_chunk<<<chunks_, whole_warps((m_ + 1) * m_), chunk_bytes(m_), device_.stream()>>>(
        steps, x, length_, products_.data(), sums_.data());
    const Chain chunk_chain{products_.data(), nullptr, m_, chunks_, m_, false, false};
    substitute<<<1, whole_warps(lanes * m_), 0, device_.stream()>>>(chunk_chain, sums_.data(), chunks_, nullptr);
    substitute<<<chunks_, whole_warps(lanes * m_), 0, device_.stream()>>>(steps, x, length_, sums_.data());
    check(cudaGetLastError(), "starting the scan");
  }

  void double_windows(int level, const double* mu, double* next) override {
    const int length = 1 << level;
    for (Memory<double>& windows : windows_)
      if (windows.size() == 0 && M_ > 1)
        windows = Memory<double>(device_, std::size_t(M_) * std::size_t(m_) * std::size_t(m_));
    Chain steps = along(Direction::backward);
    if (level > 0) {
      steps.matrices = windows_[(level - 1) % 2].data();
      steps.map_of = nullptr;
    }
    double_window_rows<<<M_ - length + 1, threads, window_bytes(), device_.stream()>>>(steps, length, mu, next,
                                                                                       windows_[level % 2].data());
    check(cudaGetLastError(), "starting a doubling");
  }

  void carry(const double* q, const double* mu, double* next) override {
    sweep_rows<<<row_blocks(), threads, 0, device_.stream()>>>(along(Direction::backward), true, q, mu, next);
    check(cudaGetLastError(), "starting a sweep");
  }

  int length_ = 1, chunks_ = 1;  ///< of a scan
  Memory<int> map_of_;
  Memory<double> D_, inverse_, R_, change_;
  Memory<double> products_, sums_, windows_[2];
};

}  // namespace

std::unique_ptr<StepChain> make_step_chain(const Device& device, const StepChainProblem& problem) {
  problem.validate();
  const Index m = problem.states();
  if (problem.steps() > most_steps || (problem.sparse() && m > most_written_out)) return nullptr;
  if (m > most_states || chunk_bytes(m) > device.shared_memory()) return make_large_step_chain(device, problem);
  return std::make_unique<SmallStepChain>(device, problem);
}

}  // namespace bromwich::cuda

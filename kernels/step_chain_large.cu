// Chains of one-step maps with too many states for one block (core/host/step_chain.hpp), dense or converted to dense.
// Notation of step_chain.cu: x_p = q_p + x_{p-1} (I + X_p), X = D^T forward in time, D for the adjoint.
//
// Operations on all rows: rows of one kind are gathered, multiplied by cuBLAS, one product per kind, and scattered.
// Serial: one launch per step, one warp per state; the launch takes longer than the product. Scan: all chunks in
// lockstep, as batched products of (m+1) x m with m x m matrices, then one serial run from chunk to chunk, then all
// chunks in lockstep again. Doubling: batched products of all windows.

#include "kernels/blas.hpp"
#include "kernels/parts.hpp"
#include "kernels/step_chain.hpp"

#include "core/base/error.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace bromwich::cuda {

namespace {

constexpr int block_threads = 256, block_columns = block_threads / 32;
constexpr Index most_batched = 16384;       ///< products per call
constexpr Index serial_steps = 256;         ///< up to here a scan is no faster
constexpr Index most_scanned_states = 384;  ///< above it, 2 m^3 operations per step take longer than a launch

/// X_i by kind, column-major, and the direction.
struct Steps {
  const double* matrices;
  const int* map_of;  ///< null: step i has matrix i
  int m, height;      ///< height: rows of a matrix as stored
  int M, stride;      ///< stride: between rows
  bool backward;      ///< position p is row M - p

  __device__ long row(int p) const { return long(backward ? M - p : p) * stride; }
  __device__ const double* of_place(int i) const {
    return matrices + long(map_of ? __ldg(map_of + i) : i) * height * m;
  }
  __device__ const double* of_position(int p) const { return of_place(backward ? M - p : p - 1); }
};

// Σ_k row_k X_kj by one warp.
__device__ double column_product(const double* row, const double* X, const Steps& s, int j) {
  const double* column = X + long(j) * s.height;
  double sum = 0;
  for (int k = threadIdx.x % 32; k < s.m; k += 32) sum += row[k] * __ldg(column + k);
  for (int offset = 16; offset > 0; offset /= 2) sum += __shfl_xor_sync(~0u, sum, offset);
  return sum;
}

// Overwrites q in x with the solution at position `at` of every chunk. `entry` has the rows before the chunks; null if
// they are in x.
__global__ void step_rows(Steps s, double* x, const double* entry, int length, int at) {
  const int p = blockIdx.y * length + 1 + at, j = blockIdx.x * block_columns + threadIdx.x / 32;
  if (j >= s.m || p > s.M) return;
  const double* before = entry && at == 0 ? entry + long(blockIdx.y) * s.m : x + s.row(p - 1);
  const double sum = column_product(before, s.of_position(p), s, j);
  if (threadIdx.x % 32 == 0) x[s.row(p) + j] = before[j] + (x[s.row(p) + j] + sum);
}

// next_i = mu_i + mu_{i+length} (I + X_i) for i <= M - length, X_i of the window that follows row i.
__global__ void double_rows(Steps s, int length, const double* __restrict__ mu, double* __restrict__ next) {
  const int across = (s.m + block_columns - 1) / block_columns, i = blockIdx.x / across,
            j = blockIdx.x % across * block_columns + threadIdx.x / 32;
  if (j >= s.m) return;
  const double* later = mu + long(i + length) * s.stride;
  const double sum = column_product(later, s.of_place(i), s, j);
  if (threadIdx.x % 32 == 0) next[long(i) * s.stride + j] = mu[long(i) * s.stride + j] + (later[j] + sum);
}

// longer_i = X_{i+length} + X_i, to which their product is added later; also lists the pointers for that product.
__global__ void add_windows(Steps s, int length, double* __restrict__ longer, const double** late, const double** early,
                            double** sum) {
  const int i = blockIdx.x;
  const long size = long(s.m) * s.m;
  const double *X = s.of_place(i), *Y = s.of_place(i + length);
  double* out = longer + i * size;
  for (long o = threadIdx.x; o < size; o += blockDim.x) out[o] = X[o] + Y[o];
  if (threadIdx.x > 0) return;
  late[i] = Y;
  early[i] = X;
  sum[i] = out;
}

// For each chunk in lockstep: [C; c] + [X; q], (m+1) x m, with the increment C of its product so far and the
// contribution c of its own q; [C; c] X is added later.
__global__ void add_step(Steps s, const double* __restrict__ q, int length, int at, const double* __restrict__ from,
                         double* __restrict__ to, const double** now, const double** X, double** next) {
  const int b = blockIdx.x, p = b * length + 1 + at, rows = s.m + 1;
  const long size = long(rows) * s.m;
  const double *before = from + b * size, *matrix = s.of_position(p);
  double* after = to + b * size;
  for (long o = threadIdx.x; o < size; o += blockDim.x) {
    const int r = int(o % rows), j = int(o / rows);
    const double own = r < s.m ? matrix[long(j) * s.height + r] : q[s.row(p) + j];
    after[o] = at == 0 ? own : before[o] + own;
  }
  if (threadIdx.x > 0) return;
  now[b] = before;
  X[b] = matrix;
  next[b] = after;
}

// The last row of every chunk's product: the contribution of its own q.
__global__ void take_sums(const double* __restrict__ products, int m, double* __restrict__ sums) {
  const long b = blockIdx.x;
  for (int j = threadIdx.x; j < m; j += blockDim.x) sums[(b + 1) * m + j] = products[(b * m + j) * (m + 1) + m];
}

// packed_p = in_{place + shift}, or the difference to the row before.
__global__ void gather_rows(const int* __restrict__ places, int shift, int stride, bool difference,
                            const double* __restrict__ in, double* __restrict__ packed) {
  const double* row = in + long(places[blockIdx.x] + shift) * stride;
  for (int j = threadIdx.x; j < stride; j += blockDim.x)
    packed[long(blockIdx.x) * stride + j] = difference ? row[j] - row[j - stride] : row[j];
}

// out_{place + shift} = add_{place + shift} + packed_p + other_p; null terms are skipped.
__global__ void scatter_rows(const int* __restrict__ places, int shift, int m, int stride,
                             const double* __restrict__ packed, const double* __restrict__ other, const double* add,
                             double* out) {
  const long from = long(blockIdx.x) * stride, to = long(places[blockIdx.x] + shift) * stride;
  for (int j = threadIdx.x; j < m; j += blockDim.x) {
    double sum = packed[from + j];
    if (add) sum += add[to + j];
    if (other) sum += other[from + j];
    out[to + j] = sum;
  }
}

class LargeStepChain final : public DeviceStepChain {
 public:
  LargeStepChain(const Device& device, const StepChainProblem& problem)
      : DeviceStepChain(device, problem),
        blas_(shared_blas(device)),
        map_of_(device, problem.map_of.size()),
        places_(device, problem.map_of.size()),
        packed_(device, M_, m_),
        product_(device, M_, m_) {
    const std::vector<int> map_of(problem.map_of.begin(), problem.map_of.end());
    map_of_.put(map_of.data());
    sort_places(map_of, problem.maps.size());
    const std::size_t size = std::size_t(m_) * std::size_t(m_), all = size * problem.maps.size();
    for (Memory<double>* matrices : {&D_, &D_transposed_, &inverse_, &R_, &change_})
      *matrices = Memory<double>(device, all);
    for (std::size_t k = 0; k < problem.maps.size(); ++k) {
      const DenseStep step(problem, Index(k));
      put(D_, k, step.increment);
      put(D_transposed_, k, Matrix(step.increment.transpose()));
      put(inverse_, k, step.inverse);
      put(R_, k, step.R);
      put(change_, k, step.change);
    }
    const double fits = memory_limit_ / (16.0 * double(m_ + 1) * double(m_));
    const int chunks = std::clamp(int(std::min(fits, 2 * std::sqrt(double(M_)))), 1, M_);
    length_ = (M_ + chunks - 1) / chunks;
    chunks_ = (M_ + length_ - 1) / length_;
  }

  std::size_t bytes() const override {
    std::size_t sum = map_of_.bytes() + places_.bytes() + 5 * D_.bytes() + 2 * mu_.bytes() + 2 * packed_.bytes();
    for (const Memory<double>& matrices : products_) sum += matrices.bytes();
    return sum + sums_.bytes() + 3 * sum_.bytes();
  }

 private:
  void start(const double* d, double* x) override {
    copy_rows(d, x, 0, 1);
    multiply(inverse_, true, d, 1, false);
    scatter(1, nullptr, nullptr, x);
  }

  void finish(const double* mu, double* l) override {
    copy_rows(mu, l, 0, 1);
    multiply(inverse_, false, mu, 1, false);
    scatter(1, nullptr, nullptr, l);
  }

  void sweep(const Array& q, const Array& l, Array& z) override {
    copy_rows(values(q), values(mu_), 0, M_ + 1);
    multiply(R_, false, values(l), 1, false);
    scatter(0, nullptr, values(q), values(mu_));
    finish(values(mu_), values(z));
  }

  void residual(const Array& d, const Array& x, Array& r) override {
    multiply(change_, true, values(x), 1, false);
    scatter(1, nullptr, values(d), values(r));
    multiply(R_, true, values(x), 1, true, -1);
    scatter(1, nullptr, values(r), values(r));
  }

  struct Group {
    std::size_t kind;
    int first, count;  ///< range in places_
  };

  void sort_places(const std::vector<int>& map_of, std::size_t kinds) {
    std::vector<int> end(kinds + 1, 0), places(map_of.size());
    for (const int k : map_of) ++end[std::size_t(k) + 1];
    for (std::size_t k = 0; k < kinds; ++k) {
      if (end[k + 1] > 0) groups_.push_back({k, end[k], end[k + 1]});
      end[k + 1] += end[k];
    }
    for (std::size_t i = 0; i < map_of.size(); ++i) places[std::size_t(end[std::size_t(map_of[i])]++)] = int(i);
    places_.put(places.data());
  }

  void put(Memory<double>& matrices, std::size_t kind, const Matrix& matrix) const {
    const std::size_t size = std::size_t(m_) * std::size_t(m_);
    check(cudaMemcpyAsync(matrices.data() + kind * size, matrix.data(), sizeof(double) * size, cudaMemcpyHostToDevice,
                          device_.stream()),
          "copying to the device");
    device_.wait();
  }

  Steps in_time(Direction direction) const {
    const bool backward = direction == Direction::backward;
    return {(backward ? D_ : D_transposed_).data(), map_of_.data(), m_, m_, M_, int(stride(m_)), backward};
  }
  unsigned across() const { return unsigned((m_ + block_columns - 1) / block_columns); }
  double scan_bytes() const override { return 16.0 * double(chunks_) * double(m_ + 1) * double(m_); }

  // product_p = s in_{place + shift} X (X^T if `transposed`) with X of the kind of the place; rows are columns to
  // cuBLAS.
  void multiply(const Memory<double>& X, bool transposed, const double* in, int shift, bool difference, double s = 1) {
    const int step = int(stride(m_));
    gather_rows<<<unsigned(M_), block_threads, 0, device_.stream()>>>(places_.data(), shift, step, difference, in,
                                                                      values(packed_));
    check(cudaGetLastError(), "gathering rows");
    const double zero = 0;
    for (const Group& group : groups_) {
      const double* matrix = X.data() + group.kind * std::size_t(m_) * std::size_t(m_);
      const long at = long(group.first) * step;
      check(cublasDgemm(blas_->handle, transposed ? CUBLAS_OP_N : CUBLAS_OP_T, CUBLAS_OP_N, m_, group.count, m_, &s,
                        matrix, m_, values(packed_) + at, step, &zero, values(product_) + at, step),
            "multiplying rows");
    }
  }

  void scatter(int shift, const double* other, const double* add, double* out) const {
    scatter_rows<<<unsigned(M_), block_threads, 0, device_.stream()>>>(places_.data(), shift, m_, int(stride(m_)),
                                                                       values(product_), other, add, out);
    check(cudaGetLastError(), "scattering rows");
  }

  void run(Direction direction, double* x) override { run(in_time(direction), x); }

  void run(const Steps& steps, double* x) const {
    for (int at = 0; at < steps.M; ++at)
      step_rows<<<across(), block_threads, 0, device_.stream()>>>(steps, x, nullptr, steps.M, at);
    check(cudaGetLastError(), "starting the substitution");
  }

  // C_b += A_b B_b with `rows` rows, for matrices given by pointer arrays.
  void add_products(int rows, Index count) const {
    const double one = 1;
    for (Index first = 0; first < count; first += most_batched)
      check(cublasDgemmBatched(blas_->handle, CUBLAS_OP_N, CUBLAS_OP_N, rows, m_, m_, &one, left_.data() + first, rows,
                               right_.data() + first, m_, &one, sum_.data() + first, rows,
                               int(std::min(most_batched, count - first))),
            "multiplying maps");
  }

  void make_room(std::size_t products, std::size_t count) {
    if (products_[0].size() < products)
      for (Memory<double>& memory : products_) memory = Memory<double>(device_, products);
    if (left_.size() >= count) return;
    left_ = Memory<const double*>(device_, count);
    right_ = Memory<const double*>(device_, count);
    sum_ = Memory<double*>(device_, count);
  }

  bool scan_is_faster() const override { return M_ > serial_steps && m_ <= most_scanned_states; }

  void scan(Direction direction, double* x) override {
    const Steps steps = in_time(direction);
    const std::size_t size = std::size_t(m_ + 1) * std::size_t(m_);
    make_room(std::size_t(chunks_) * size, std::size_t(chunks_));
    if (sums_.size() == 0) sums_ = Memory<double>(device_, std::size_t(chunks_ + 1) * std::size_t(m_));
    const int short_length = M_ - (chunks_ - 1) * length_;
    for (int at = 0; at < length_; ++at) {
      const Index count = at < short_length ? chunks_ : chunks_ - 1;
      const double* from = products_[at % 2].data();
      double* to = products_[1 - at % 2].data();
      if (count == 0) break;
      add_step<<<unsigned(count), block_threads, 0, device_.stream()>>>(steps, x, length_, at, from, to, left_.data(),
                                                                        right_.data(), sum_.data());
      check(cudaGetLastError(), "starting the scan");
      if (at > 0) add_products(m_ + 1, count);
    }
    double* products = products_[length_ % 2].data();
    if (short_length % 2 != length_ % 2)
      check(cudaMemcpyAsync(products + std::size_t(chunks_ - 1) * size,
                            products_[short_length % 2].data() + std::size_t(chunks_ - 1) * size, sizeof(double) * size,
                            cudaMemcpyDeviceToDevice, device_.stream()),
            "copying a product");
    check(cudaMemcpyAsync(sums_.data(), x + (steps.backward ? long(M_) * steps.stride : 0),
                          sizeof(double) * std::size_t(m_), cudaMemcpyDeviceToDevice, device_.stream()),
          "copying rows");
    take_sums<<<unsigned(chunks_), block_threads, 0, device_.stream()>>>(products, m_, sums_.data());
    run({products, nullptr, m_, m_ + 1, chunks_, m_, false}, sums_.data());
    for (int at = 0; at < length_; ++at)
      step_rows<<<dim3(across(), unsigned(chunks_)), block_threads, 0, device_.stream()>>>(steps, x, sums_.data(),
                                                                                           length_, at);
    check(cudaGetLastError(), "starting the scan");
  }

  void double_windows(int level, const double* mu, double* next) override {
    const int length = 1 << level;
    make_room(std::size_t(m_) * std::size_t(m_) * std::size_t(M_), std::size_t(M_));
    Steps steps = in_time(Direction::backward);
    if (level > 0) {
      steps.matrices = products_[(level - 1) % 2].data();
      steps.map_of = nullptr;
    }
    double_rows<<<unsigned(M_ - length + 1) * across(), block_threads, 0, device_.stream()>>>(steps, length, mu, next);
    check(cudaGetLastError(), "starting a doubling");
    const int windows = M_ - 2 * length + 1;
    if (windows < 1) return;
    add_windows<<<unsigned(windows), block_threads, 0, device_.stream()>>>(steps, length, products_[level % 2].data(),
                                                                           left_.data(), right_.data(), sum_.data());
    check(cudaGetLastError(), "starting a doubling");
    add_products(m_, windows);
  }

  void carry(const double* q, const double* mu, double* next) override {
    copy_rows(q, next, M_, 1);
    multiply(D_, false, mu, 1, false);
    scatter(0, values(packed_), q, next);
  }

  std::shared_ptr<Blas> blas_;
  int length_ = 1, chunks_ = 1;  ///< of a scan
  Memory<int> map_of_, places_;  ///< places, sorted by kind
  std::vector<Group> groups_;
  DeviceArray packed_, product_;
  Memory<double> D_, D_transposed_, inverse_, R_, change_;
  Memory<double> products_[2], sums_;
  Memory<const double*> left_, right_;
  Memory<double*> sum_;
};

}  // namespace

std::unique_ptr<StepChain> make_large_step_chain(const Device& device, const StepChainProblem& problem) {
  return std::make_unique<LargeStepChain>(device, problem);
}

}  // namespace bromwich::cuda

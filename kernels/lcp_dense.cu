// Batched complementarity problems with one small dense matrix. Up to eight constraints: one thread per problem, all in
// registers. Up to `largest_shared_size`: one warp per problem, with the eliminated matrix in shared memory. A Newton
// sweep eliminates, without row exchanges, the matrix that equals M on the active set and the identity elsewhere. All
// leading minors of a P-matrix are positive; a row whose pivot fails is left to pivoting on the host.

#include "kernels/launch.cuh"
#include "kernels/lcp_outcome.cuh"
#include "kernels/parts.hpp"
#include "kernels/reciprocal.cuh"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich::cuda {

namespace {

constexpr int largest_register_size = 8, largest_shared_size = 64;
constexpr int block = 128;  ///< threads per block, one problem each

/// R M C by rows, and its scales.
struct Coefficients {
  const double *M, *row_scale, *column_scale;
};

// Loads n neighbouring values, two at a time if 16-byte aligned.
template <int n>
__device__ void load(const double* from, double (&to)[n]) {
  if constexpr (n % 2 == 0) {
#pragma unroll
    for (int i = 0; i < n; i += 2) {
      const double2 two = *reinterpret_cast<const double2*>(from + i);
      to[i] = two.x, to[i + 1] = two.y;
    }
  } else {
#pragma unroll
    for (int i = 0; i < n; ++i) to[i] = from[i];
  }
}
template <int n>
__device__ void store(const double (&from)[n], double* to) {
  if constexpr (n % 2 == 0) {
#pragma unroll
    for (int i = 0; i < n; i += 2) *reinterpret_cast<double2*>(to + i) = {from[i], from[i + 1]};
  } else {
#pragma unroll
    for (int i = 0; i < n; ++i) to[i] = from[i];
  }
}

/// One problem in registers.
template <int n>
struct Problem {
  double q[n], x[n];
  unsigned active = 0;
  double size = 0;  ///< largest |q_i|
  bool positive = false;

  __device__ void eliminate(const double* M) {
    double a[n][n];
    positive = true;
#pragma unroll
    for (int i = 0; i < n; ++i) {
      const bool on = active >> i & 1;
#pragma unroll
      for (int k = 0; k < n; ++k) a[i][k] = on && (active >> k & 1) ? M[i * n + k] : 0;
      if (!on) a[i][i] = 1;
      x[i] = on ? -q[i] : 0;
    }
#pragma unroll
    for (int k = 0; k < n; ++k) {
      positive = positive && a[k][k] > 16 * n * epsilon * M[k * n + k];
      const double inverse = reciprocal(a[k][k]);
      a[k][k] = inverse;
#pragma unroll
      for (int i = k + 1; i < n; ++i) {
        const double factor = a[i][k] * inverse;
#pragma unroll
        for (int l = k + 1; l < n; ++l) a[i][l] -= factor * a[k][l];
        x[i] -= factor * x[k];
      }
    }
#pragma unroll
    for (int i = n - 1; i >= 0; --i) {
#pragma unroll
      for (int k = i + 1; k < n; ++k) x[i] -= a[i][k] * x[k];
      x[i] *= a[i][i];
    }
  }

  // Flips the indices with the wrong sign; returns whether there was any.
  __device__ bool exchange(const double* M, double tolerance) {
    unsigned flips = 0;
#pragma unroll
    for (int i = 0; i < n; ++i) {
      double w = q[i];
#pragma unroll
      for (int k = 0; k < n; ++k) w += M[i * n + k] * x[k];
      if (((active >> i & 1) ? x[i] : w) < -tolerance) flips |= 1u << i;
    }
    active ^= flips;
    return flips != 0;
  }
};

// One thread per problem; a block takes consecutive rows.
template <int n>
__global__ void __launch_bounds__(block)
    newton_in_registers(LcpArrays arrays, Coefficients m, int first, int rows, bool least, OutcomeTarget target) {
  __shared__ double M[n * n], row_scale[n], column_scale[n];
  let_next_begin();
  for (int i = threadIdx.x; i < n * n; i += blockDim.x) M[i] = m.M[i];
  for (int i = threadIdx.x; i < n; i += blockDim.x) row_scale[i] = m.row_scale[i], column_scale[i] = m.column_scale[i];
  __syncthreads();
  await_previous();
  Outcomes outcomes(target);
  for (int j = first + blockIdx.x * block + threadIdx.x; j < rows; j += gridDim.x * block) {
    const long at = long(j) * n;
    Problem<n> p;
    double r[n], v[n], old[n];
    load(arrays.r + at, r), load(arrays.v + at, v), load(arrays.y + at, old);
#pragma unroll
    for (int i = 0; i < n; ++i) {
      p.q[i] = row_scale[i] * (r[i] + v[i]);
      if (old[i] > 0) p.active |= 1u << i;
      p.size = larger(fabs(p.q[i]), p.size);
    }
    bool same = false;
    int sweeps = 0;
    while (!same && sweeps < 8 + n) {
      ++sweeps;
      p.eliminate(M);
      same = !p.exchange(M, 16 * epsilon * p.size);
    }
    double change = 0, magnitude = 0;
#pragma unroll
    for (int i = 0; i < n; ++i) {
      p.x[i] = p.x[i] <= 0 ? 0 : column_scale[i] * p.x[i];  // keeps a NaN
      change = larger(fabs(p.x[i] - old[i]), change);
      magnitude = larger(fabs(p.x[i]), magnitude);
    }
    if (same && (!least || p.positive) && isfinite(p.size) && isfinite(change) && isfinite(magnitude)) {
      store(p.x, arrays.y + at);
      outcomes.solved(j, sweeps, change, magnitude);
    } else {
      outcomes.unsolved(j, sweeps);
    }
  }
  outcomes.finish();
}

__device__ double largest_of_warp(double mine) {
  for (int s = 16; s > 0; s /= 2) mine = larger(mine, __shfl_xor_sync(0xffffffffu, mine, s));
  return mine;
}

// x for the active set, by one warp. Returns whether all pivots were positive.
__device__ bool eliminate(int n, const double* M, const double* active, const double* q, double* a, double* x) {
  const int t = threadIdx.x, step = n + 1;
  bool positive = true;
  __syncwarp();
  for (int i = t; i < n; i += 32) {
    for (int k = 0; k < n; ++k) a[i * step + k] = active[i] * active[k] * M[i * n + k];
    a[i * step + i] += 1 - active[i];
    x[i] = -active[i] * q[i];
  }
  __syncwarp();
  for (int k = 0; k < n; ++k) {
    const double pivot = a[k * step + k];
    positive = positive && pivot > 16 * n * epsilon * M[k * n + k];
    for (int i = t; i < n; i += 32) {
      if (i <= k) continue;
      const double factor = a[i * step + k] / pivot;
      for (int l = k + 1; l < n; ++l) a[i * step + l] -= factor * a[k * step + l];
      x[i] -= factor * x[k];
    }
    __syncwarp();
  }
  for (int k = n - 1; k >= 0; --k) {
    if (t == k % 32) x[k] /= a[k * step + k];
    __syncwarp();
    for (int i = t; i < k; i += 32) x[i] -= a[i * step + k] * x[k];
    __syncwarp();
  }
  return positive;
}

// Flips the indices with the wrong sign; returns whether the warp had any.
__device__ bool exchange(int n, const double* M, const double* q, const double* x, double* active, double tolerance) {
  bool flipped = false;
  for (int i = threadIdx.x; i < n; i += 32) {
    double w = q[i];
    for (int k = 0; k < n; ++k) w += M[i * n + k] * x[k];
    if ((active[i] > 0.5 ? x[i] : w) < -tolerance) {
      active[i] = 1 - active[i];
      flipped = true;
    }
  }
  return __any_sync(0xffffffffu, flipped);
}

// Blocks of one warp, each taking every gridDim.x-th problem; thread t has the rows t, t + 32.
__global__ void __launch_bounds__(32)
    newton_in_shared(LcpArrays arrays, Coefficients m, int n, int first, int rows, bool least, OutcomeTarget target) {
  extern __shared__ double shared[];
  let_next_begin();
  await_previous();
  double *a = shared, *x = a + n * (n + 1), *q = x + n, *active = q + n;
  const int t = threadIdx.x;
  Outcomes outcomes(target);
  for (int j = first + blockIdx.x; j < rows; j += gridDim.x) {
    const long at = long(j) * arrays.stride;
    double size = 0;
    for (int i = t; i < n; i += 32) {
      q[i] = m.row_scale[i] * (arrays.r[at + i] + arrays.v[at + i]);
      active[i] = arrays.y[at + i] > 0 ? 1 : 0;
      size = larger(fabs(q[i]), size);
    }
    size = largest_of_warp(size);
    bool same = false, positive = false;
    int sweeps = 0;
    while (!same && sweeps < 8 + n) {
      ++sweeps;
      positive = eliminate(n, m.M, active, q, a, x);
      same = !exchange(n, m.M, q, x, active, 16 * epsilon * size);
    }
    double change = 0, magnitude = 0;
    for (int i = t; i < n; i += 32) {
      x[i] = x[i] <= 0 ? 0 : m.column_scale[i] * x[i];  // keeps a NaN
      change = larger(fabs(x[i] - arrays.y[at + i]), change);
      magnitude = larger(fabs(x[i]), magnitude);
    }
    change = largest_of_warp(change), magnitude = largest_of_warp(magnitude);
    const bool finite = isfinite(size) && isfinite(change) && isfinite(magnitude);
    const bool solved = finite && same && (!least || positive);
    if (solved)
      for (int i = t; i < n; i += 32) arrays.y[at + i] = x[i];
    if (t == 0) {
      if (solved)
        outcomes.solved(j, sweeps, change, magnitude);
      else
        outcomes.unsolved(j, sweeps);
    }
    __syncwarp();
  }
  outcomes.finish();
}

// One warp per row, with the unscaled M.
__global__ void natural_residual(const double* r, const double* v, const double* y, const double* M, int n, int stride,
                                 int rows, double* out) {
  const int j = blockIdx.x * blockDim.y + threadIdx.y;
  if (j >= rows) return;
  const long at = long(j) * stride;
  double gap = 0, scale = 1;
  for (int i = threadIdx.x; i < n; i += 32) {
    const double q = r[at + i] + v[at + i];
    double w = q;
    for (int k = 0; k < n; ++k) w += M[i * n + k] * y[at + k];
    gap = larger(isfinite(w + y[at + i]) ? fabs(fmin(y[at + i], w)) : nan(""), gap);
    scale = fmax(scale, fabs(q));
  }
  gap = largest_of_warp(gap), scale = largest_of_warp(scale);
  if (threadIdx.x == 0) out[j] = gap / scale;
}

using RegisterKernel = void (*)(LcpArrays, Coefficients, int, int, bool, OutcomeTarget);

template <int... sizes>
RegisterKernel register_kernel(Index n, std::integer_sequence<int, sizes...>) {
  constexpr RegisterKernel kernels[] = {newton_in_registers<sizes + 1>...};
  return kernels[n - 1];
}

RegisterKernel register_kernel(Index n) {
  return register_kernel(n, std::make_integer_sequence<int, largest_register_size>());
}

class DenseLcp final : public LcpBatch {
 public:
  DenseLcp(const Device& device, const Matrix& M, LcpClass lcp_class, Index rows)
      : LcpBatch(false),
        device_(device),
        n_(M.rows()),
        class_(selection_class(M, lcp_class)),
        outcomes_(device, rows),
        residuals_(device, std::size_t(rows)),
        given_(on_device(device, RowMatrix(M))),
        solver_(M, class_) {
    const Equilibration scale = equilibrate(M);
    M_ = on_device(device, RowMatrix(scaled(M, scale)));
    row_scale_ = on_device(device, scale.rows);
    column_scale_ = on_device(device, scale.columns);
  }

  void submit(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    if (first >= y.rows()) return;
    const LcpArrays arrays{values(r), values(v), values(y), int(stride(n_))};
    const Index rows = y.rows();
    const OutcomeTarget target = outcomes_.target(rows - first, settle_tolerance, settle_tolerance >= 0);
    const bool least = selects_least(class_);
    const unsigned most = unsigned(device_.multiprocessors());
    const char* const what = "starting the complementarity problems";
    if (n_ <= largest_register_size) {
      const unsigned blocks = std::min(unsigned((rows - first + block - 1) / block), 16 * most);
      follow(device_, register_kernel(n_), {blocks, block}, what, arrays, coefficients(), int(first), int(rows), least,
             target);
    } else {
      const std::size_t shared = sizeof(double) * std::size_t(n_ * (n_ + 1) + 3 * n_);
      const unsigned blocks = std::min(unsigned(rows - first), 32 * most);
      follow(device_, newton_in_shared, {blocks, 32, shared}, what, arrays, coefficients(), int(n_), int(first),
             int(rows), least, target);
    }
  }
  LcpReport collect() override { return outcomes_.collect(); }
  LcpReport finish(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    return outcomes_.report(r, v, y, first, settle_tolerance, [this]() -> ActiveSetLcp& { return solver_; });
  }

  double residual(const Array& r, const Array& v, const Array& y) override {
    natural_residual<<<unsigned((y.rows() + 3) / 4), dim3(32, 4), 0, device_.stream()>>>(
        values(r), values(v), values(y), given_.data(), int(n_), int(stride(n_)), int(y.rows()), residuals_.data());
    check(cudaGetLastError(), "starting the residual");
    return largest(device_, residuals_);
  }

  std::size_t bytes() const override { return outcomes_.bytes() + residuals_.bytes() + 2 * M_.bytes(); }

 private:
  Coefficients coefficients() const { return {M_.data(), row_scale_.data(), column_scale_.data()}; }

  const Device& device_;
  Index n_;
  LcpClass class_;
  BatchOutcomes outcomes_;
  Memory<double> residuals_, given_, M_, row_scale_, column_scale_;
  ActiveSetLcp solver_;
};

}  // namespace

std::unique_ptr<LcpBatch> make_dense_lcp(const Device& device, const Matrix& M, LcpClass lcp_class, Index rows) {
  if (M.rows() < 1 || M.rows() > largest_shared_size) return nullptr;
  return std::make_unique<DenseLcp>(device, M, lcp_class, rows);
}

}  // namespace bromwich::cuda

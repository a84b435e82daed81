// Batched complementarity problems with one dense matrix. Up to eight constraints: one thread per problem, all in
// registers. A Newton sweep eliminates, without row exchanges, the matrix that equals M on the active set and the
// identity elsewhere. All leading minors of a P-matrix are positive; a row whose pivot fails is left to pivoting on the
// host. Larger and semidefinite problems: lcp_lanes.cu, lcp_blocks.cu.

#include "kernels/launch.cuh"
#include "kernels/lcp_dense.hpp"
#include "kernels/lcp_outcome.cuh"
#include "kernels/parts.hpp"
#include "kernels/reciprocal.cuh"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace bromwich::cuda {

namespace {

constexpr int largest_register_size = 8;
constexpr int block = 128;  ///< threads per block, one problem each

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
    newton_in_registers(LcpArrays arrays, DenseProblems m, int first, int rows, OutcomeTarget target) {
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
    if (same && (!m.least || p.positive) && isfinite(p.size) && isfinite(change) && isfinite(magnitude)) {
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

using RegisterKernel = void (*)(LcpArrays, DenseProblems, int, int, OutcomeTarget);

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
    const bool semidefinite = selects_least_norm(class_);
    if (n_ <= largest_register_size && !semidefinite) return;
    blocks_.emplace(device, n_, rows, semidefinite ? M.cwiseAbs().maxCoeff() : 0);
    if (n_ <= largest_in_lanes && !semidefinite) left_ = Memory<int>(device, std::size_t(rows) + 1);
  }

  void submit(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    if (first >= y.rows()) return;
    const LcpArrays arrays{values(r), values(v), values(y), int(stride(n_))};
    const int begin = int(first), end = int(y.rows());
    const OutcomeTarget target = outcomes_.target(end - begin, settle_tolerance, settle_tolerance >= 0);
    if (!blocks_) {
      const unsigned most = 16 * unsigned(device_.multiprocessors());
      const unsigned blocks = std::min(unsigned((end - begin + block - 1) / block), most);
      follow(device_, register_kernel(n_), {blocks, block}, "starting the complementarity problems", arrays, problems(),
             begin, end, target);
      return;
    }
    LeftRows left{nullptr, nullptr};
    if (left_.size() > 0) {
      left = {left_.data() + 1, left_.data()};
      solve_in_lanes(device_, arrays, problems(), begin, end, left, target);
    }
    blocks_->solve(arrays, problems(), begin, end, left, target);
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

  std::size_t bytes() const override {
    return outcomes_.bytes() + residuals_.bytes() + 2 * M_.bytes() + left_.bytes() + (blocks_ ? blocks_->bytes() : 0);
  }

 private:
  DenseProblems problems() const {
    return {M_.data(), row_scale_.data(), column_scale_.data(), int(n_), selects_least(class_)};
  }

  const Device& device_;
  Index n_;
  LcpClass class_;
  BatchOutcomes outcomes_;
  Memory<double> residuals_, given_, M_, row_scale_, column_scale_;
  std::optional<BlockLcp> blocks_;  ///< of more than eight constraints, and of semidefinite M
  Memory<int> left_;                ///< their number, then the rows that lanes leave to blocks
  ActiveSetLcp solver_;
};

}  // namespace

std::unique_ptr<LcpBatch> make_dense_lcp(const Device& device, const Matrix& M, LcpClass lcp_class, Index rows) {
  if (M.rows() < 1 || M.rows() > largest_in_blocks) return nullptr;
  return std::make_unique<DenseLcp>(device, M, lcp_class, rows);
}

}  // namespace bromwich::cuda

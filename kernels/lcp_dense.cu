// Batched complementarity problems with one small dense matrix. Up to eight constraints a thread
// takes a problem and keeps everything in registers; up to `largest_shared_size` a warp does, with the eliminated
// matrix in shared memory. A Newton sweep eliminates the matrix that equals M on the active set and the identity
// elsewhere, without exchanges: all leading minors are positive for a P-matrix, and where a pivot fails the row is left
// to pivoting on the host.

#include "kernels/lcp_batch.hpp"
#include "kernels/parts.hpp"

#include <cmath>

namespace bromwich::cuda {

namespace {

constexpr int largest_shared_size = 64;

struct Arrays {
  const double *r, *v;
  double* y;
  int stride;  ///< from row to row; n where a thread takes a problem
};

/// R M C by rows, and the scales.
struct Coefficients {
  const double *M, *row_scale, *column_scale;
};

template <int n>
__global__ void __launch_bounds__(128)
    newton_in_registers(Arrays arrays, Coefficients m, int first, int rows, bool least, RowOutcome* outcomes) {
  __shared__ double M[n * n], row_scale[n], column_scale[n];
  for (int i = threadIdx.x; i < n * n; i += blockDim.x) M[i] = m.M[i];
  for (int i = threadIdx.x; i < n; i += blockDim.x) row_scale[i] = m.row_scale[i], column_scale[i] = m.column_scale[i];
  __syncthreads();
  const int j = first + blockIdx.x * blockDim.x + threadIdx.x;
  if (j >= rows) return;
  double q[n], old[n], x[n];
  unsigned active = 0;
  double size = 0;
#pragma unroll
  for (int i = 0; i < n; ++i) {
    q[i] = row_scale[i] * (arrays.r[long(j) * n + i] + arrays.v[long(j) * n + i]);
    old[i] = arrays.y[long(j) * n + i];
    if (old[i] > 0) active |= 1u << i;
    size = fmax(size, fabs(q[i]));
  }
  const double tolerance = 16 * epsilon * size;
  bool same = false, positive = false;
  int sweeps = 0;
  while (!same && sweeps < 8 + n) {
    ++sweeps;
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
      const double inverse = 1 / a[k][k];
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
    unsigned flips = 0;
#pragma unroll
    for (int i = 0; i < n; ++i) {
      double w = q[i];
#pragma unroll
      for (int k = 0; k < n; ++k) w += M[i * n + k] * x[k];
      if (((active >> i & 1) ? x[i] : w) < -tolerance) flips |= 1u << i;
    }
    active ^= flips;
    same = flips == 0;
  }
  double change = 0, magnitude = 0, sum = 0;
#pragma unroll
  for (int i = 0; i < n; ++i) {
    sum += fabs(q[i]) + fabs(x[i]);
    x[i] = column_scale[i] * fmax(x[i], 0.0);
    change = fmax(change, fabs(x[i] - old[i]));
    magnitude = fmax(magnitude, x[i]);
  }
  const bool finite = isfinite(sum), solved = finite && same && (!least || positive);
  if (solved) {
#pragma unroll
    for (int i = 0; i < n; ++i) arrays.y[long(j) * n + i] = x[i];
  }
  outcomes[j] = {finite ? change : nan(""), magnitude, solved ? sweeps : -sweeps};
}

__device__ double largest_of_warp(double mine) {
  for (int s = 16; s > 0; s /= 2) mine = fmax(mine, __shfl_xor_sync(0xffffffffu, mine, s));
  return mine;
}

// One warp a block: problem first + blockIdx.x; thread t has the rows t, t + 32.
__global__ void __launch_bounds__(32)
    newton_in_shared(Arrays arrays, Coefficients m, int n, int first, bool least, RowOutcome* outcomes) {
  extern __shared__ double shared[];
  double *a = shared, *x = a + n * (n + 1), *q = x + n, *active = q + n;
  const int t = threadIdx.x, j = first + blockIdx.x;
  const long at = long(j) * arrays.stride;
  double size = 0;
  for (int i = t; i < n; i += 32) {
    q[i] = m.row_scale[i] * (arrays.r[at + i] + arrays.v[at + i]);
    active[i] = arrays.y[at + i] > 0 ? 1 : 0;
    size = fmax(size, fabs(q[i]));
  }
  const double tolerance = 16 * epsilon * largest_of_warp(size);
  bool same = false, positive = false;
  int sweeps = 0;
  while (!same && sweeps < 8 + n) {
    ++sweeps;
    positive = true;
    __syncwarp();
    for (int i = t; i < n; i += 32) {
      for (int k = 0; k < n; ++k) a[i * (n + 1) + k] = active[i] * active[k] * m.M[i * n + k];
      a[i * (n + 1) + i] += 1 - active[i];
      x[i] = -active[i] * q[i];
    }
    __syncwarp();
    for (int k = 0; k < n; ++k) {
      const double pivot = a[k * (n + 1) + k];
      positive = positive && pivot > 16 * n * epsilon * m.M[k * n + k];
      for (int i = t; i < n; i += 32) {
        if (i <= k) continue;
        const double factor = a[i * (n + 1) + k] / pivot;
        for (int l = k + 1; l < n; ++l) a[i * (n + 1) + l] -= factor * a[k * (n + 1) + l];
        x[i] -= factor * x[k];
      }
      __syncwarp();
    }
    for (int k = n - 1; k >= 0; --k) {
      if (t == k % 32) x[k] /= a[k * (n + 1) + k];
      __syncwarp();
      for (int i = t; i < k; i += 32) x[i] -= a[i * (n + 1) + k] * x[k];
      __syncwarp();
    }
    bool flipped = false;
    for (int i = t; i < n; i += 32) {
      double w = q[i];
      for (int k = 0; k < n; ++k) w += m.M[i * n + k] * x[k];
      if ((active[i] > 0.5 ? x[i] : w) < -tolerance) {
        active[i] = 1 - active[i];
        flipped = true;
      }
    }
    same = !__any_sync(0xffffffffu, flipped);
  }
  double change = 0, magnitude = 0, bad = 0;
  for (int i = t; i < n; i += 32) {
    if (!isfinite(q[i]) || !isfinite(x[i])) bad = 1;
    x[i] = m.column_scale[i] * fmax(x[i], 0.0);
    change = fmax(change, fabs(x[i] - arrays.y[at + i]));
    magnitude = fmax(magnitude, x[i]);
  }
  change = largest_of_warp(change), magnitude = largest_of_warp(magnitude);
  const bool finite = largest_of_warp(bad) == 0, solved = finite && same && (!least || positive);
  if (solved)
    for (int i = t; i < n; i += 32) arrays.y[at + i] = x[i];
  if (t == 0) outcomes[j] = {finite ? change : nan(""), magnitude, solved ? sweeps : -sweeps};
}

// A warp a row, with M as it was given.
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
    gap = isfinite(w + y[at + i]) ? fmax(gap, fabs(fmin(y[at + i], w))) : INFINITY;
    scale = fmax(scale, fabs(q));
  }
  gap = largest_of_warp(gap), scale = largest_of_warp(scale);
  if (threadIdx.x == 0) out[j] = isinf(gap) ? nan("") : gap / scale;
}

class DenseLcp final : public LcpBatch {
 public:
  DenseLcp(const Device& device, const Matrix& M, LcpClass lcp_class, Index rows)
      : device_(device),
        n_(M.rows()),
        class_(selection_class(M, lcp_class)),
        outcomes_(device, rows),
        residuals_(device, std::size_t(rows)),
        given_(on_device(device, RowMatrix(M))),
        solver_(M, class_) {
    const Equilibration scale = equilibrate(M);
    M_ = on_device(device, RowMatrix(std::get<Matrix>(scaled(M, scale))));
    row_scale_ = on_device(device, scale.rows);
    column_scale_ = on_device(device, scale.columns);
  }

  LcpReport solve(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    if (first < y.rows()) start({values(r), values(v), values(y), int(stride(n_))}, first, y.rows());
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
  void start(const Arrays& arrays, Index first, Index rows) {
    switch (n_) {
      case 1:
        return in_registers<1>(arrays, first, rows);
      case 2:
        return in_registers<2>(arrays, first, rows);
      case 3:
        return in_registers<3>(arrays, first, rows);
      case 4:
        return in_registers<4>(arrays, first, rows);
      case 5:
        return in_registers<5>(arrays, first, rows);
      case 6:
        return in_registers<6>(arrays, first, rows);
      case 7:
        return in_registers<7>(arrays, first, rows);
      case 8:
        return in_registers<8>(arrays, first, rows);
      default:
        break;
    }
    const std::size_t shared = sizeof(double) * std::size_t(n_ * (n_ + 1) + 3 * n_);
    newton_in_shared<<<unsigned(rows - first), 32, shared, device_.stream()>>>(
        arrays, coefficients(), int(n_), int(first), class_ == LcpClass::Z, outcomes_.data());
    check(cudaGetLastError(), "starting the complementarity problems");
  }

  template <int n>
  void in_registers(const Arrays& arrays, Index first, Index rows) {
    const unsigned blocks = unsigned((rows - first + 127) / 128);
    newton_in_registers<n><<<blocks, 128, 0, device_.stream()>>>(arrays, coefficients(), int(first), int(rows),
                                                                 class_ == LcpClass::Z, outcomes_.data());
    check(cudaGetLastError(), "starting the complementarity problems");
  }

  Coefficients coefficients() const { return {M_.data(), row_scale_.data(), column_scale_.data()}; }

  const Device& device_;
  Index n_;
  LcpClass class_;
  RowOutcomes outcomes_;
  Memory<double> residuals_, given_, M_, row_scale_, column_scale_;
  ActiveSetLcp solver_;
};

}  // namespace

std::unique_ptr<LcpBatch> make_dense_lcp(const Device& device, const Matrix& M, LcpClass lcp_class, Index rows) {
  if (M.rows() < 1 || M.rows() > largest_shared_size) return nullptr;
  return std::make_unique<DenseLcp>(device, M, lcp_class, rows);
}

}  // namespace bromwich::cuda

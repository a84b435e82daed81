#pragma once
// What a march (kernels/march.cu) does with its rows before and after the steps: the state of the first step, v from
// its modes, and the check of every row against the given M, r and v.

#include "kernels/lcp_outcome.cuh"
#include "kernels/march_steps.hpp"

#include <cmath>

namespace bromwich::cuda {

namespace {

constexpr int threads = 128;

// Allowed residual of a row from rounding and from drift of the updated transform, relative to its largest term: the
// bound of is_solution() for n = 1000.
constexpr double tolerance = 4e-12;

/// The unscaled M: bands, or all columns.
struct GivenMatrix {
  const double *lower, *diagonal, *upper, *dense;

  __device__ double row_times(int i, int n, const double* y, double& terms) const {
    double sum = 0;
    const auto add = [&](double m, double value) { sum += m * value, terms += fabs(m * value); };
    if (dense) {
      for (int k = 0; k < n; ++k) add(dense[long(k) * n + i], y[k]);
      return sum;
    }
    add(diagonal[i], y[i]);
    if (i > 0) add(lower[i], y[i - 1]);
    if (i + 1 < n) add(upper[i], y[i + 1]);
    return sum;
  }
};

template <class Operation>
__device__ double reduced(double mine, Operation operation) {
  __shared__ double values[threads];
  values[threadIdx.x] = mine;
  for (int half = threads / 2; half > 0; half /= 2) {
    __syncthreads();
    if (threadIdx.x < half) values[threadIdx.x] = operation(values[threadIdx.x], values[threadIdx.x + half]);
  }
  __syncthreads();
  const double all = values[0];
  __syncthreads();
  return all;
}

__device__ double sum_of_block(double mine) {
  return reduced(mine, [](double a, double b) { return a + b; });
}

__device__ double largest_of_block(double mine) {
  return reduced(mine, [](double a, double b) { return larger(a, b); });
}

/// Data of the first step: z_0 = G0 u_0 + initial; lag 1 of y_0 has the additional weight s1.
struct First {
  const double *start, *initial, *s1;
};

// One block per mode: z and free of step 1 from y_0 and the drive.
__global__ void begin(StepTables m, First first, StepArrays a, double* z, double* known) {
  const int l = blockIdx.x;
  double sum = 0;
  for (int c = threadIdx.x; c < m.n; c += threads) sum += m.sine[long(l) * m.n + c] * a.y[c];
  const double u = sum_of_block(sum) + (a.drive ? a.drive[l] : 0);
  sum = 0;
  for (int k = threadIdx.x; k < m.exponentials; k += threads) {
    const long at = long(k) * m.n + l;
    const double value = first.start[at] * u + (first.initial ? first.initial[at] : 0);
    z[at] = value;
    sum += m.output[at] * value;
  }
  sum = sum_of_block(sum) + first.s1[l] * u;
  if (threadIdx.x == 0) known[l] = sum + (a.drive ? m.w0[l] * a.drive[a.step + l] : 0);
}

// free <- free + w0 u, one block per row j >= 1.
__global__ void add_implicit(const double* w0, int n, int step, const double* u, double* known) {
  const long at = long(blockIdx.x + 1) * step;
  for (int l = threadIdx.x; l < n; l += threads) known[at + l] += w0[l] * u[at + l];
}

// One block per row j >= 1. Checks min(y, w) = 0 with w = M y + r + v, and that the u used by the steps is S y.
__global__ void check_rows(StepTables m, GivenMatrix M, StepArrays a, const double* v, const double* exact_u,
                           StepOutcome* out) {
  const long at = long(blockIdx.x + 1) * a.step;
  const double* const y = a.y + at;
  double worst = 0, scale = 0, column = 0, gap = 0;
  for (int i = threadIdx.x; i < m.n; i += threads) {
    double terms = fabs(a.r[at + i]) + fabs(v[at + i]);
    const double w = m.row_scale[i] * (M.row_times(i, m.n, y, terms) + a.r[at + i] + v[at + i]);
    const double wrong = y[i] > 0 ? fabs(w) : y[i] < 0 ? nan("") : fmax(-w, 0.0);
    worst = larger(isnan(w) ? w : wrong, worst);
    scale = fmax(scale, fmax(m.row_scale[i] * terms, y[i] / m.column_scale[i]));
    column = fmax(column, m.column_scale[i]);
    gap = larger(fabs(a.input[at + i] - exact_u[at + i]), gap);
  }
  scale = largest_of_block(scale), worst = largest_of_block(worst);
  column = largest_of_block(column), gap = largest_of_block(gap);
  if (threadIdx.x == 0 && !(worst <= tolerance * scale && gap <= tolerance * scale * column)) out->drifted = 1;
}

/// Sums over all queued runs since the plan was made. Monotone.
struct MarchTotals {
  long long sweeps, fallbacks, runs, failed;
};

__global__ void tally(const StepOutcome* run, int rows, MarchTotals* totals) {
  totals->sweeps += run->sweeps;
  totals->fallbacks += run->fallbacks;
  totals->failed += rows > 1 && (run->drifted != 0 || run->reached < rows) ? 1 : 0;
  ++totals->runs;
}

__global__ void invalidate(double* y, double* v, int n, int step, int from) {
  const long at = long(from + blockIdx.x) * step;
  for (int i = threadIdx.x; i < n; i += threads) y[at + i] = v[at + i] = nan("");
}

}  // namespace

}  // namespace bromwich::cuda

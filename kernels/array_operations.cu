// Operations on whole arrays that a hierarchy of time grids needs: one pass over memory each, a thread per number.
// Rows keep their stride; what lies between them stays zero.

#include "kernels/lcp_batch.hpp"
#include "kernels/lcp_outcome.cuh"
#include "kernels/parts.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich::cuda {

namespace {

constexpr int threads = 256;
constexpr Index most_blocks = 1 << 16;

unsigned blocks(Index values) { return unsigned(std::min((values + threads - 1) / threads, most_blocks)); }

__device__ long first_value() { return blockIdx.x * long(blockDim.x) + threadIdx.x; }
__device__ long all_threads() { return gridDim.x * long(blockDim.x); }

__global__ void take_rows(const double* fine, long ratio, long step, long values, double* coarse) {
  for (long i = first_value(); i < values; i += all_threads()) {
    const long row = i / step, column = i - row * step;
    coarse[i] = fine[row * ratio * step + column];
  }
}

// A thread per number of the fine array: row j lies between the rows j/2 and (j+1)/2 of the coarse one.
__global__ void add_interpolation(const double* coarse, const double* old, long step, long values, double* fine) {
  for (long i = first_value(); i < values; i += all_threads()) {
    const long row = i / step, column = i - row * step;
    const long left = (row / 2) * step + column, right = ((row + 1) / 2) * step + column;
    const double at_left = coarse[left] - (old ? old[left] : 0);
    const double at_right = coarse[right] - (old ? old[right] : 0);
    fine[i] += 0.5 * (at_left + at_right);
  }
}

__global__ void pose(const double* r, const double* v, const double* y, const double* coarse_v, long step, long values,
                     double* coarse_r, double* coarse_y, double* old) {
  for (long i = first_value(); i < values; i += all_threads()) {
    const long fine = i + i / step * step;
    coarse_r[i] = r[fine] + v[fine] - coarse_v[i];
    coarse_y[i] = old[i] = y[fine];
  }
}

__global__ void add_multiple(const double* b, double s, const double* c, long values, double* a) {
  for (long i = first_value(); i < values; i += all_threads()) a[i] = b[i] + s * c[i];
}

// A warp per row.
__global__ void differences(const double* a, const double* b, int rows, int cols, int step, double* out) {
  const int row = int(blockIdx.x) * int(blockDim.y) + int(threadIdx.y);
  if (row >= rows) return;  // the same for all lanes of the warp
  const double* const p = a + long(row) * step;
  const double* const q = b + long(row) * step;
  double gap = 0, size = 1;
  for (int i = int(threadIdx.x); i < cols; i += 32) {
    gap = larger(fabs(p[i] - q[i]), gap);
    size = fmax(size, fabs(p[i]));
  }
  for (int lane = 16; lane > 0; lane /= 2) {
    gap = larger(__shfl_xor_sync(~0u, gap, lane), gap);
    size = fmax(size, __shfl_xor_sync(~0u, size, lane));
  }
  if (threadIdx.x == 0) out[row] = gap / size;
}

Index values_of(const Array& array) { return array.rows() * stride(array.cols()); }

}  // namespace

void inject(const Device& device, const Array& fine, Array& coarse) {
  const Index ratio = (fine.rows() - 1) / (coarse.rows() - 1), size = values_of(coarse);
  take_rows<<<blocks(size), threads, 0, device.stream()>>>(values(fine), ratio, stride(coarse.cols()), size,
                                                           values(coarse));
  check(cudaGetLastError(), "starting an injection");
}

void interpolate(const Device& device, const Array& coarse, const Array* old, Array& fine) {
  const Index size = values_of(fine);
  add_interpolation<<<blocks(size), threads, 0, device.stream()>>>(values(coarse), old ? values(*old) : nullptr,
                                                                   stride(fine.cols()), size, values(fine));
  check(cudaGetLastError(), "starting an interpolation");
}

void restrict_problem(const Device& device, const Array& r, const Array& v, const Array& y, const Array& coarse_v,
                      Array& coarse_r, Array& coarse_y, Array& old) {
  const Index size = values_of(coarse_y);
  pose<<<blocks(size), threads, 0, device.stream()>>>(values(r), values(v), values(y), values(coarse_v),
                                                      stride(coarse_y.cols()), size, values(coarse_r), values(coarse_y),
                                                      values(old));
  check(cudaGetLastError(), "posing a coarse problem");
}

void add(const Device& device, const Array& b, double s, const Array& c, Array& a) {
  const Index size = values_of(a);
  add_multiple<<<blocks(size), threads, 0, device.stream()>>>(values(b), s, values(c), size, values(a));
  check(cudaGetLastError(), "starting a sum of arrays");
}

double difference(const Device& device, const Array& a, const Array& b) {
  Memory<double> per_row(device, std::size_t(a.rows()));
  differences<<<unsigned((a.rows() + 7) / 8), dim3(32, 8), 0, device.stream()>>>(
      values(a), values(b), int(a.rows()), int(a.cols()), int(stride(a.cols())), per_row.data());
  check(cudaGetLastError(), "starting a difference of arrays");
  const double found = largest(device, per_row);
  return std::isfinite(found) ? found : NAN;
}

}  // namespace bromwich::cuda

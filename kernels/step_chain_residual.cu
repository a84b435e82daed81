// Weighted residuals of chains. The weights inside each cell result from two sweeps of block-Jacobi. The first, with
// the l of each cell's end placed at its midpoint, gives the weights of second half steps; the second sweep, started
// from the first, gives those of first half steps.

#include "kernels/host_plans.hpp"
#include "kernels/step_chain.hpp"

namespace bromwich::cuda {

namespace {

constexpr int threads = 256;

// w_i = z_i^T r_i, one warp per row.
__global__ void weigh_rows(const double* __restrict__ z, const double* __restrict__ r, long rows, int m, int stride,
                           double* __restrict__ w) {
  const long i = long(blockIdx.x) * (threads / 32) + threadIdx.x / 32;
  if (i >= rows) return;
  double sum = 0;
  for (int k = threadIdx.x % 32; k < m; k += 32) sum += z[i * stride + k] * r[i * stride + k];
  for (int offset = 16; offset > 0; offset /= 2) sum += __shfl_xor_sync(~0u, sum, offset);
  if (threadIdx.x % 32 == 0) w[i] = sum;
}

std::unique_ptr<DeviceArray> on_device_rows(const Device& device, const RowMatrix& rows) {
  auto array = std::make_unique<DeviceArray>(device, rows.rows(), rows.cols());
  upload(device, rows, *array);
  return array;
}

/// z_i^T r_i for rows 1..M.
Vector weighed(const Device& device, const DeviceArray& z, const DeviceArray& r) {
  const long rows = long(r.rows()), warps = threads / 32;
  Memory<double> w(device, std::size_t(rows));
  weigh_rows<<<unsigned((rows + warps - 1) / warps), threads, 0, device.stream()>>>(
      values(z), values(r), rows, int(r.cols()), int(stride(r.cols())), w.data());
  check(cudaGetLastError(), "weighing rows");
  Vector found(rows);
  w.get(found.data());
  return found.tail(rows - 1);
}

}  // namespace

Vector DeviceStepChain::weighted_residual(const RowMatrix& d, const RowMatrix& x, const RowMatrix& z) {
  DeviceArray r(device_, x.rows(), x.cols());
  residual(*on_device_rows(device_, d), *on_device_rows(device_, x), r);
  return weighed(device_, *on_device_rows(device_, z), r);
}

Vector DeviceStepChain::locally_weighted_residual(const RowMatrix& d, const RowMatrix& x, const RowMatrix& q,
                                                  const RowMatrix& l) {
  DeviceArray r(device_, x.rows(), x.cols());
  residual(*on_device_rows(device_, d), *on_device_rows(device_, x), r);
  const auto coarse = on_device_rows(device_, l);
  DeviceArray behind(device_, q.rows(), q.cols());  // row 2c - 1 is l_c
  const std::size_t row = sizeof(double) * std::size_t(stride(q.cols()));
  check(cudaMemcpy2DAsync(values(behind) + stride(q.cols()), 2 * row, values(*coarse) + stride(q.cols()), row, row,
                          std::size_t(l.rows() - 1), cudaMemcpyDeviceToDevice, device_.stream()),
        "copying rows");
  const auto gradient = on_device_rows(device_, q);
  DeviceArray second(device_, q.rows(), q.cols()), first(device_, q.rows(), q.cols());
  sweep(*gradient, behind, second);
  sweep(*gradient, second, first);
  const Vector of_first = weighed(device_, first, r);
  Vector w = weighed(device_, second, r);
  for (Index i = 0; i < w.size(); i += 2) w[i] = of_first[i];
  return w;
}

}  // namespace bromwich::cuda

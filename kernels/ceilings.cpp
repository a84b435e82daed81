#include "kernels/ceilings.hpp"

#include "kernels/parts.hpp"

#include <cublas_v2.h>

#include <algorithm>

namespace bromwich {

namespace {

/// The shortest time of several runs, in seconds.
template <class Run>
double shortest(const cuda::Device& device, Run run) {
  cudaEvent_t start, stop;
  cuda::check(cudaEventCreate(&start), "timing");
  cuda::check(cudaEventCreate(&stop), "timing");
  double best = INFINITY;
  for (int i = 0; i < 8; ++i) {
    cudaEventRecord(start, device.stream());
    run();
    cudaEventRecord(stop, device.stream());
    cuda::check(cudaEventSynchronize(stop), "timing");
    float milliseconds = 0;
    cudaEventElapsedTime(&milliseconds, start, stop);
    best = std::min(best, 1e-3 * double(milliseconds));
  }
  cudaEventDestroy(start);
  cudaEventDestroy(stop);
  return best;
}

}  // namespace

CudaCeilings cuda_ceilings() {
  const cuda::Device device(0);
  CudaCeilings found;
  {
    const std::size_t size = std::size_t(1) << 28;
    cuda::Memory<double> from(device, size), to(device, size);
    from.clear();
    const double seconds = shortest(device, [&] {
      cudaMemcpyAsync(to.data(), from.data(), from.bytes(), cudaMemcpyDeviceToDevice, device.stream());
    });
    found.copy_bytes_per_second = 2 * double(from.bytes()) / seconds;
  }
  const int n = 8192;
  const Matrix values = Matrix::Random(n, n);
  cuda::Memory<double> a = cuda::on_device(device, values), b = cuda::on_device(device, values), c(device, a.size());
  cublasHandle_t handle;
  cublasCreate(&handle);
  cublasSetStream(handle, device.stream());
  const double one = 1, zero = 0;
  const double seconds = shortest(device, [&] {
    cublasDgemm(handle, CUBLAS_OP_N, CUBLAS_OP_N, n, n, n, &one, a.data(), n, b.data(), n, &zero, c.data(), n);
  });
  cublasDestroy(handle);
  found.gemm_flops_per_second = 2.0 * n * n * n / seconds;
  return found;
}

CudaTransformSeconds cuda_transform_seconds(Index n, Index rows) {
  const cuda::Device device(0);
  const cuda::DeviceArray from(device, rows, n);
  cuda::DeviceArray to(device, rows, n);
  const auto product = cuda::make_sine_product(device, n), fft = cuda::make_sine_fft(device, n, rows);
  return {shortest(device, [&] { product->apply(from, nullptr, to, 0); }),
          shortest(device, [&] { fft->apply(from, nullptr, to, 0); })};
}

}  // namespace bromwich

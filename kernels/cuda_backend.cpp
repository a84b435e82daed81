#include "kernels/cuda_backend.hpp"

#include "core/base/error.hpp"
#include "core/lcp/active_set.hpp"
#include "core/seam/affine_chain.hpp"
#include "core/seam/step_chain.hpp"
#include "kernels/host_plans.hpp"
#include "kernels/parts.hpp"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <string>

namespace bromwich {

namespace {

// What the driver has free, and what the pool and the device keep of what was freed. Never 0, which would mean no
// memory of its own.
double free_memory(const cuda::Device& device) {
  std::size_t free = 0, total = 0;
  std::uint64_t reserved = 0, used = 0;
  int number = 0;
  cudaMemPool_t pool;
  cuda::check(cudaMemGetInfo(&free, &total), "asking for the free memory");
  cuda::check(cudaGetDevice(&number), "asking for the device");
  cuda::check(cudaDeviceGetDefaultMemPool(&pool, number), "asking for the memory pool");
  cuda::check(cudaMemPoolGetAttribute(pool, cudaMemPoolAttrReservedMemCurrent, &reserved), "asking the memory pool");
  cuda::check(cudaMemPoolGetAttribute(pool, cudaMemPoolAttrUsedMemCurrent, &used), "asking the memory pool");
  return std::max(1.0, double(free) + double(reserved) - double(used) + double(device.blocks().kept()));
}

class CudaBackend final : public Backend {
 public:
  CudaBackend(std::unique_ptr<Backend> host, int number, std::string name)
      : host_(std::move(host)), device_(number), name_(std::move(name)) {}

  std::string name() const override { return "cuda"; }
  DeviceInfo device() const override { return {name_, host_->device().threads, "cuBLAS, cuFFT", free_memory(device_)}; }

  void each_range(Index count, Index length, const std::function<void(Index first, Index last)>& body) const override {
    device_.fetcher().each_range(count, length, body);
  }

  std::unique_ptr<Array> array(Index rows, Index cols) override {
    return std::make_unique<cuda::DeviceArray>(device_, rows, cols);
  }
  void upload(const RowMatrix& from, Array& to) override { cuda::upload(device_, from, to); }
  void upload_product(const RowMatrix& amplitudes, const Matrix& shapes, Array& to) override {
    cuda::upload_product(device_, amplitudes, shapes, to);
  }
  void upload_projection(const Vector& from, const Array& P, Array& to) override {
    cuda::upload_projection(device_, from, P, to);
  }
  void download(const Array& from, RowMatrix& to) override { cuda::download(device_, from, to); }
  void download_during(const Array& from, RowMatrix& to, const std::function<void()>& operations) override {
    cuda::download(device_, from, to, operations);
  }
  void prepare(RowMatrix& to, Index rows, Index cols) override {
    to.resize(rows, cols);
    device_.fetcher().fill(to.data(), std::size_t(to.size()), std::numeric_limits<double>::quiet_NaN());
  }

  void inject(const Array& fine, Array& coarse) override { cuda::inject(device_, fine, coarse); }
  void interpolate(const Array& coarse, const Array* old, Array& fine) override {
    cuda::interpolate(device_, coarse, old, fine);
  }
  void restrict_problem(const Array& r, const Array& v, const Array& y, const Array& coarse_v, Array& coarse_r,
                        Array& coarse_y, Array& old) override {
    cuda::restrict_problem(device_, r, v, y, coarse_v, coarse_r, coarse_y, old);
  }
  void add(const Array& b, double s, const Array& c, Array& a) override { cuda::add(device_, b, s, c, a); }
  double difference(const Array& a, const Array& b) override {
    const auto one = differences(1);
    one->start(0, a, b);
    return one->collect()[0];
  }
  std::unique_ptr<Differences> differences(std::size_t slots) override {
    return cuda::make_differences(device_, *this, slots);
  }
  bool alternates(const Array& y, Index run, double part) override { return cuda::alternates(device_, y, run, part); }

  std::unique_ptr<SineTransform> sine_transform(Index n, Index rows) override {
    return cuda::make_sine_transform(device_, n, rows);
  }
  std::unique_ptr<Convolution> convolution(const Recurrence& recurrence, Index rows) override {
    return std::visit([&](const auto& r) { return cuda::make_convolution(device_, r, rows); }, recurrence);
  }
  std::unique_ptr<Convolution> convolution(const LagTable& table, Index rows) override {
    return cuda::make_fft_convolution(device_, table, rows);
  }
  std::unique_ptr<LcpBatch> shifted_lcp(const LcpMatrix& M, LcpClass lcp_class, double shift, Index rows) override {
    // Which solution of a semidefinite problem is the least in norm takes more than an active set.
    const bool semidefinite = selection_class(M, lcp_class) == LcpClass::PSD;
    const auto* tridiagonal = std::get_if<Tridiagonal>(&M);
    std::unique_ptr<LcpBatch> plan;
    if (!semidefinite && tridiagonal && size(M) > 0)
      plan = cuda::make_tridiagonal_lcp(device_, *tridiagonal, lcp_class, shift, rows);
    else if (!semidefinite && !tridiagonal && shift == 0 && size(M) > 0)
      plan = cuda::make_dense_lcp(device_, std::get<Matrix>(M), lcp_class, rows);
    return plan ? std::move(plan) : cuda::make_host_lcp(device_, *host_, M, lcp_class, shift, rows);
  }
  std::unique_ptr<March> march(const MarchProblem& problem, Index rows) override {
    return cuda::make_march(device_, *host_, problem, rows);
  }
  std::unique_ptr<StageMarch> stage_march(const StageProblem& problem, Index rows) override {
    return cuda::make_host_stage_march(device_, *host_, problem, rows);
  }
  std::unique_ptr<StepChain> step_chain(const StepChainProblem& problem) override {
    return cuda::make_step_chain(device_, *host_, problem);
  }
  std::unique_ptr<AffineChain> affine_chain(const AffineChainSizes& sizes) override {
    return cuda::make_affine_chain(device_, *host_, sizes);
  }
  void wait() override { device_.wait(); }
  std::unique_ptr<Program> record(Index values, const std::function<void()>& operations) override {
    return cuda::make_program(device_, values, operations);
  }
  ComplexMatrix resolvent(const Dynamics& dynamics, const ComplexVector& nodes) override {
    if (const auto* d = std::get_if<DenseDynamics>(&dynamics)) return resolvent_(*d, nodes);
    if (const auto* d = std::get_if<KroneckerDynamics>(&dynamics)) return resolvent_(*d, nodes);
    return host_->resolvent(dynamics, nodes);
  }

 private:
  std::unique_ptr<Backend> host_;
  cuda::Device device_;
  cuda::Resolvent resolvent_{device_};
  std::string name_;
};

}  // namespace

std::vector<std::string> cuda_devices() {
  int count = 0;
  std::vector<std::string> names;
  if (cudaGetDeviceCount(&count) != cudaSuccess) return names;  // no driver is no device
  for (int i = 0; i < count; ++i) {
    cudaDeviceProp properties;
    if (cudaGetDeviceProperties(&properties, i) == cudaSuccess) names.emplace_back(properties.name);
  }
  return names;
}

bool cuda_built() { return true; }

std::unique_ptr<Backend> make_cuda_backend(std::unique_ptr<Backend> host, int device) {
  const std::vector<std::string> names = cuda_devices();
  if (device < 0 || device >= int(names.size()))
    throw Error("device", "found " + std::to_string(device) + " where there are " + std::to_string(names.size()),
                "use a machine with a CUDA device and its driver, or the cpu backend");
  return std::make_unique<CudaBackend>(std::move(host), device, names[std::size_t(device)]);
}

}  // namespace bromwich

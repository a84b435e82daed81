#include "kernels/cuda_backend.hpp"

#include "core/base/error.hpp"
#include "core/lcp/active_set.hpp"
#include "core/seam/shared_memory.hpp"
#include "kernels/convolution_stages.hpp"
#include "kernels/host_plans.hpp"
#include "kernels/parts.hpp"

#include <algorithm>
#include <cstdint>
#include <string>

namespace bromwich {

namespace {

// Free memory of the driver plus what the pool and the device's cache keep. At least 1: 0 means that arrays use the
// memory of the host.
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

constexpr Index most_states_of_host = 16;  ///< of a shifted solve that takes less time than a launch

constexpr Index fewest_sparse_states = 4096;  ///< of shifted solves by cuDSS

class CudaBackend final : public Backend, public SharedMemory, public ChunkMarcher, public PointResponder {
 public:
  CudaBackend(std::unique_ptr<Backend> host, int number, std::string device_name)
      : Backend("cuda", cuda_traits()),
        host_(std::move(host)),
        number_(number),
        device_(number),
        device_name_(std::move(device_name)) {
    fused_.record = [this](Index values, const std::function<void()>& operations) {
      return cuda::record(device_, values, operations);
    };
    fused_.upload_product = [this](const RowMatrix& amplitudes, const Matrix& shapes, Array& to) {
      cuda::upload_product(device_, amplitudes, shapes, to);
    };
    fused_.upload_projection = [this](const Vector& from, const Array& P, Array& to) {
      cuda::upload_projection(device_, from, P, to);
    };
    fused_.download_during = [this](const Array& from, RowMatrix& to, const std::function<void()>& operations) {
      cuda::download(device_, from, to, operations);
    };
    fused_.restrict_problem = [this](const Array& r, const Array& v, const Array& y, const Array& coarse_v,
                                     Array& coarse_r, Array& coarse_y, Array& old) {
      cuda::restrict_problem(device_, r, v, y, coarse_v, coarse_r, coarse_y, old);
    };
    staged_.take_stages = [this](const Array& stages, Array& first, Array& second) {
      cuda::take_stages(device_, stages, first, second);
    };
    staged_.put_stages = [this](const Array& first, const Array& second, Array& stages) {
      cuda::put_stages(device_, first, second, stages);
    };
    staged_.stage_convolution = [this](const StageRecurrence& r, Index rows) {
      return cuda::make_stage_scan(device_, r, rows);
    };
    staged_.sweep_stages = [this](const StageDivisors& d, const Array& r, const Array& v, Array& y) {
      cuda::sweep_stages(device_, d, r, v, y);
    };
    staged_.restrict_stages = [this](const Array& r, const Array& v, const Array& y, const Array& coarse_v,
                                     Array& coarse_r, Array& coarse_y, Array& old) {
      cuda::restrict_stages(device_, r, v, y, coarse_v, coarse_r, coarse_y, old);
    };
    fused_.face_transform = [this](const FaceBasis& basis, Index, Way way) {
      return cuda::make_face_transform(device_, basis, way);
    };
    fused_.projected_sweeps = [this](const ProjectedSweeps& sweeps, Index rows) {
      return cuda::make_projected_sweeps(device_, sweeps, rows);
    };
    fused_.alternates = [this](const Array& y, Index run, double part) {
      return cuda::alternates(device_, y, run, part);
    };
    fused_.step_chain = [this](const StepChainProblem& problem) {
      auto chain = cuda::make_step_chain(device_, problem);
      return chain ? std::move(chain) : host_->step_chain(problem);
    };
    fused_.affine_chain = [this](const AffineChainSizes& sizes) {
      auto chain = cuda::make_affine_chain(device_, sizes);
      return chain ? std::move(chain) : host_->affine_chain(sizes);
    };
    fused_.resolvent = [this](const Dynamics& dynamics, const ComplexVector& nodes) -> ComplexMatrix {
      if (const auto* d = dynamics->small_state(); d && d->A.rows() > most_states_of_host) return resolvent_(*d, nodes);
      if (const auto* d = dynamics->modes(); d && d->across.has_sine_modes() && !d->both_faces)
        return resolvent_(*d, nodes);
      if (const auto* d = dynamics->matrices(); d && d->A.rows() >= fewest_sparse_states)
        return cuda::sparse_resolvent(device_, *host_, dynamics, nodes);
      return host_->resolvent(dynamics, nodes);
    };
    fused_.slabs.move_rows = [this](const Array* from, Index first, Index ratio, Array& to, Index begin, Index count) {
      cuda::move_rows(device_, from, first, ratio, to, begin, count);
    };
    fused_.slabs.download_rows = [this](const Array& from, Index first, Index count, double* to) {
      cuda::download_rows(device_, from, first, count, to);
    };
    fused_.slabs.upload_rows = [this](const double* from, Array& to, Index first, Index count) {
      cuda::upload_rows(device_, from, to, first, count);
    };
    fused_.slabs.interpolate_rows = [this](const Array& coarse, const Array* old, Index ratio, Index first,
                                           Array& fine) {
      cuda::interpolate_rows(device_, coarse, old, ratio, first, fine);
    };
    fused_.slabs.carried_convolution = [this](const ModalRecurrence& r, const std::vector<Index>& ends, int rank) {
      return cuda::make_carried_scan(device_, r, ends, rank);
    };
    fused_.scene_arrays = [this](const SceneArraysProblem& problem, Index scenes) {
      return cuda::make_scene_arrays(device_, problem, scenes);
    };
    fused_.scene_march = [this](const SceneMarchProblem& problem, Index scenes) {
      return cuda::make_scene_march(device_, problem, scenes);
    };
  }

  DeviceInfo device() const override {
    return {device_name_, host_->device().threads, "cuBLAS, cuFFT", free_memory(device_)};
  }
  int threads() const override { return host_->threads(); }

  void each_range(Index count, Index length, const std::function<void(Index first, Index last)>& body) const override {
    device_.fetcher().each_range(count, length, body);
  }

  std::unique_ptr<ChunkMarch> chunk_march(const ChunkMarchProblem& problem) override {
    return cuda::make_chunk_march(device_, problem);
  }

  std::unique_ptr<PointResponses> point_responses(const PointResponseProblem& problem) override {
    return cuda::make_point_responses(device_, *host_, problem);
  }

  std::unique_ptr<Array> array(Index rows, Index cols) override {
    return std::make_unique<cuda::DeviceArray>(device_, rows, cols);
  }
  void upload(const RowMatrix& from, Array& to) override { cuda::upload(device_, from, to); }
  void download(const Array& from, RowMatrix& to) override { cuda::download(device_, from, to); }

  void inject(const Array& fine, Array& coarse) override { cuda::inject(device_, fine, coarse); }
  void interpolate(const Array& coarse, const Array* old, Array& fine) override {
    cuda::interpolate(device_, coarse, old, fine);
  }
  void add(const Array& b, double s, const Array& c, Array& a) override { cuda::add(device_, b, s, c, a); }
  std::unique_ptr<Differences> differences(std::size_t slots) override {
    return cuda::make_differences(device_, slots);
  }

  std::unique_ptr<RowTransform> sine_transform(Index n, Index rows) override {
    return cuda::make_sine_transform(device_, n, rows);
  }
  std::unique_ptr<Convolution> convolution(WeightsRef weights, Index rows) override {
    return std::visit([&](const auto* w) { return cuda::make_convolution(device_, *w, rows); }, weights);
  }
  std::unique_ptr<LcpBatch> shifted_lcp(const LcpMatrix& M, LcpClass lcp_class, double shift, Index rows) override {
    // The least-norm solution of a semidefinite problem needs more than an active set: kernels of dense M have it.
    const bool semidefinite = selects_least_norm(selection_class(M, lcp_class));
    const auto* tridiagonal = std::get_if<Tridiagonal>(&M);
    std::unique_ptr<LcpBatch> plan;
    if (!semidefinite && tridiagonal && size(M) > 0)
      plan = cuda::make_tridiagonal_lcp(device_, *tridiagonal, lcp_class, shift, rows);
    else if (std::holds_alternative<Matrix>(M) && shift == 0 && size(M) > 0)
      plan = cuda::make_dense_lcp(device_, std::get<Matrix>(M), lcp_class, rows);
    else if (const SparseMatrix* sparse = sparse_of(M); !semidefinite && sparse && shift == 0 && size(M) > 0)
      plan = cuda::make_face_lcp(device_, *sparse, rows);
    return plan ? std::move(plan) : cuda::make_host_lcp(device_, *host_, M, lcp_class, shift, rows);
  }
  std::unique_ptr<March> march(const MarchProblem& problem, Index rows) override {
    return cuda::make_march(device_, *host_, problem, rows);
  }
  void wait() override { device_.wait(); }

  // SharedMemory
  Place place() const override { return {2, number_, reinterpret_cast<std::uintptr_t>(device_.stream())}; }
  std::shared_ptr<double> numbers(Index values) override { return cuda::numbers(values); }
  void read(const double* from, Array& to) override { cuda::read(device_, from, to); }
  void write(const Array& from, double* to) override { cuda::write(device_, from, to); }
  void to_host(const void* from, std::size_t bytes, void* to) override { cuda::to_host(device_, from, bytes, to); }
  void add_product(const LcpMatrix& M, const Array& y, Array& q) override { cuda::add_product(device_, M, y, q); }

 private:
  std::unique_ptr<Backend> host_;
  int number_;
  cuda::Device device_;
  cuda::Resolvent resolvent_{device_};
  std::string device_name_;
};

}  // namespace

std::vector<std::string> cuda_devices() {
  int count = 0;
  std::vector<std::string> names;
  if (cudaGetDeviceCount(&count) != cudaSuccess) return names;  // no driver: no device
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

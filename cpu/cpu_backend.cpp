#include "cpu/cpu_backend.hpp"

#include "core/base/error.hpp"
#include "core/seam/shared_memory.hpp"
#include "cpu/parts.hpp"
#include "cpu/real_fft.hpp"

#include <omp.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <string>

namespace bromwich {

namespace {

class CpuBackend final : public Backend, public SharedMemory {
 public:
  explicit CpuBackend(int threads) : Backend("cpu", cpu_traits()), team_(threads) {
    fused_.upload_product = [this](const RowMatrix& amplitudes, const Matrix& shapes, Array& to) {
      cpu::write_product(amplitudes, shapes, cpu::host(to), team_);
    };
    fused_.restrict_problem = [this](const Array& r, const Array& v, const Array& y, const Array& coarse_v,
                                     Array& coarse_r, Array& coarse_y, Array& old) {
      cpu::restrict_problem(cpu::host(r), cpu::host(v), cpu::host(y), cpu::host(coarse_v), cpu::host(coarse_r),
                            cpu::host(coarse_y), cpu::host(old), team_);
    };
    staged_.take_stages = [this](const Array& stages, Array& first, Array& second) {
      cpu::take_stages(cpu::host(stages), cpu::host(first), cpu::host(second), team_);
    };
    staged_.put_stages = [this](const Array& first, const Array& second, Array& stages) {
      cpu::put_stages(cpu::host(first), cpu::host(second), cpu::host(stages), team_);
    };
    staged_.sweep_stages = [this](const StageDivisors& d, const Array& r, const Array& v, Array& y) {
      cpu::sweep_stages(d, cpu::host(r), cpu::host(v), cpu::host(y), team_);
    };
    staged_.restrict_stages = [this](const Array& r, const Array& v, const Array& y, const Array& coarse_v,
                                     Array& coarse_r, Array& coarse_y, Array& old) {
      cpu::restrict_stages(cpu::host(r), cpu::host(v), cpu::host(y), cpu::host(coarse_v), cpu::host(coarse_r),
                           cpu::host(coarse_y), cpu::host(old), team_);
    };
    fused_.face_transform = [this](const FaceBasis& basis, Index rows, Way way) {
      return cpu::make_face_transform(basis, rows, way, team_);
    };
    fused_.linear_march = [this](const MarchProblem& problem, Index rows, const LinearStep& step) {
      return cpu::make_march(problem, rows, team_, step);
    };
    fused_.projected_sweeps = [this](const ProjectedSweeps& sweeps, Index rows) {
      return cpu::make_projected_sweeps(sweeps, rows, team_);
    };
    fused_.alternates = [this](const Array& y, Index run, double part) {
      return cpu::alternates(cpu::host(y), run, part, team_);
    };
  }

  DeviceInfo device() const override {
    return {"cpu", team_.threads(), std::string("OpenMP, ") + cpu::transform_library()};
  }
  int threads() const override { return team_.threads(); }
  void each_range(Index count, Index length, const std::function<void(Index first, Index last)>& body) const override {
    const Index ranges = (count + length - 1) / length;
    team_.share(ranges, [&](Index r, int) { body(r * length, std::min((r + 1) * length, count)); });
  }

  std::unique_ptr<Array> array(Index rows, Index cols) override {
    return std::make_unique<cpu::HostArray>(rows, cols, team_);
  }
  void upload(const RowMatrix& from, Array& to) override { copy(from, cpu::host(to)); }
  void download(const Array& from, RowMatrix& to) override {
    to.resize(from.rows(), from.cols());
    copy(cpu::host(from), to);
  }

  void inject(const Array& fine, Array& coarse) override { cpu::inject(cpu::host(fine), cpu::host(coarse), team_); }
  void interpolate(const Array& coarse, const Array* old, Array& fine) override {
    cpu::interpolate(cpu::host(coarse), old ? &cpu::host(*old) : nullptr, cpu::host(fine), team_);
  }
  void add(const Array& b, double s, const Array& c, Array& a) override {
    cpu::add(cpu::host(b), s, cpu::host(c), cpu::host(a), team_);
  }
  std::unique_ptr<Differences> differences(std::size_t slots) override { return cpu::make_differences(slots, team_); }

  std::unique_ptr<RowTransform> sine_transform(Index n, Index rows) override {
    return cpu::make_sine_transform(n, rows, team_);
  }
  std::unique_ptr<Convolution> convolution(WeightsRef weights, Index rows) override {
    return std::visit([&](const auto* w) { return cpu::make_convolution(*w, rows, team_); }, weights);
  }
  std::unique_ptr<LcpBatch> shifted_lcp(const LcpMatrix& M, LcpClass lcp_class, double shift, Index rows) override {
    if (const auto* t = std::get_if<Tridiagonal>(&M))
      return cpu::make_tridiagonal_lcp(*t, lcp_class, shift, rows, team_);
    if (const SparseMatrix* sparse = sparse_of(M)) return cpu::make_sparse_lcp(*sparse, lcp_class, shift, rows, team_);
    if (shift != 0) throw Error("shift", "found a dense matrix", "shift tridiagonal and sparse ones");
    return cpu::make_dense_lcp(std::get<Matrix>(M), lcp_class, rows, team_);
  }
  std::unique_ptr<March> march(const MarchProblem& problem, Index rows) override {
    return cpu::make_march(problem, rows, team_);
  }

  // SharedMemory
  Place place() const override { return {}; }
  std::shared_ptr<double> numbers(Index values) override {
    constexpr std::size_t line = 64;  // JAX copies what is less aligned
    const std::size_t bytes = (std::size_t(values) * sizeof(double) / line + 1) * line;
    auto* memory = static_cast<double*>(std::aligned_alloc(line, bytes));
    if (!memory) throw std::bad_alloc();
    return {memory, std::free};
  }
  void read(const double* from, Array& to) override {
    copy(Eigen::Map<const RowMatrix>(from, to.rows(), to.cols()), cpu::host(to));
  }
  void write(const Array& from, double* to) override {
    Eigen::Map<RowMatrix> target(to, from.rows(), from.cols());
    copy(cpu::host(from), target);
  }
  void to_host(const void* from, std::size_t bytes, void* to) override { std::memcpy(to, from, bytes); }
  void add_product(const LcpMatrix& M, const Array& y, Array& q) override {
    const RowMatrix& Y = cpu::host(y);
    RowMatrix& Q = cpu::host(q);
    if (const auto* dense = std::get_if<Matrix>(&M)) {
      Q.noalias() += Y * dense->transpose();
      return;
    }
    team_.each(Y.rows(), Y.size() > cpu::worth_sharing,
               [&](Index j) { Q.row(j) += multiply(M, Y.row(j).transpose()).transpose(); });
  }

 private:
  template <class From, class To>
  void copy(const From& from, To& to) const {
    team_.each(from.rows(), from.size() > cpu::worth_sharing, [&](Index j) { to.row(j) = from.row(j); });
  }

  mutable cpu::Team team_;  ///< of one loop at a time
};

}  // namespace

BackendTraits cpu_traits() {
  BackendTraits traits;
  traits.march = [](double n, double J) { return 0.013 * n + 1.2e-4 * n * n + 3.4e-5 * n * J + 6e-4 * J; };
  traits.face_march = [](double n, double J) { return 2 + 4e-6 * n * J * std::sqrt(n); };
  return traits;
}

std::unique_ptr<Backend> make_cpu_backend(int threads) {
  if (threads < 0)
    throw Error("threads", "found " + std::to_string(threads), "pass 0 for all cores, or a number of threads");
  return std::make_unique<CpuBackend>(threads == 0 ? omp_get_max_threads() : threads);
}

}  // namespace bromwich

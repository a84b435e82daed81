// Many small dense scenes, one thread each (core/host/scene_steps.hpp). Numbers of neighbouring threads are adjacent
// in memory. One kernel takes the steps. One transposes the results into rows of scenes, in the units of the scenes.
// The checks are a kernel of another stream and run while the rows are copied to the host.

#include "core/host/scene_steps.hpp"
#include "core/host/stored_problem.hpp"
#include "core/scene/natural_units.hpp"
#include "core/seam/scene_march.hpp"
#include "kernels/parts.hpp"

#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace bromwich::cuda {

namespace {

using scene_steps::Matrices;
using scene_steps::most_states;
using scene_steps::Rows;
using scene_steps::Sets;
using scene_steps::Source;
using scene_steps::Steps;
using scene_steps::StoredProblem;

constexpr int threads = 64;
constexpr int tile = 32;

struct Given {
  Matrices<double> matrices;
  Sets steps, growth;
  const double *longest, *drift, *g, *at_points, *growth_drift, *f, *seen, *euler;
  unsigned rigid;
  Index scenes;
  const double *x0, *y0;  // rows of scenes
  double *x, *y, *residual;
  unsigned char* lost;         // not settled
  const unsigned char* known;  // other solutions are
};

template <Index m, Index n>
__device__ Steps<m, n, double, double> steps_of(const Given& p, Index k) {
  const Index states = p.matrices.m;
  return {p.matrices,
          {p.x + k, states, p.scenes},
          {p.y + k, n, p.scenes},
          {p.drift, nullptr, states, 1},
          {p.g, nullptr, p.matrices.stages ? 2 * n : n, 1},
          {p.growth_drift, nullptr, states, 1}};
}

template <Index m, Index n>
__global__ void __launch_bounds__(threads) march_scenes(const Given p) {
  const Index k = Index(blockIdx.x) * threads + threadIdx.x;
  if (k >= p.scenes) return;
  const auto steps = steps_of<m, n>(p, k);
  for (Index i = 0; i < steps.m(); ++i) steps.x(0, i) = p.x0[k * steps.m() + i];
  for (Index i = 0; i < n; ++i) steps.y(0, i) = p.y0[k * n + i];
  bool lost = false;
  StoredProblem problem{p.steps, nullptr};
  if (p.matrices.stages) {
    if constexpr (2 * n <= scene_steps::most_unknowns)
      steps.march_stages(problem, p.rigid, lost,
                         [](Index, bool odd, const double*, double*, double*, double*, bool& gone) { gone |= odd; });
  } else {
    for (Index i = 0; i < n; ++i) problem.set |= steps.y(0, i) > 0 ? 1u << i : 0u;
    steps.march(problem, lost, [](Index, double*, double*) { return false; });
  }
  p.lost[k] = lost;
}

template <Index m, Index n>
__global__ void __launch_bounds__(threads) check_scenes(const Given p) {
  const Index k = Index(blockIdx.x) * threads + threadIdx.x;
  if (k >= p.scenes) return;
  bool lost = p.lost[k];
  const Source<double> at_points{p.at_points, nullptr, n, 1}, f{p.f, nullptr, p.matrices.m, 1};
  const auto steps = steps_of<m, n>(p, k);
  double largest_x[m > 0 ? m : most_states];
  p.residual[k] = steps.check_rows(at_points, largest_x, lost);
  if (!lost) {
    StoredProblem growth{p.growth, p.longest};
    steps.check_growth(growth, largest_x, lost);
  }
  if (!lost && p.euler && !p.known[k]) steps.check_others(p.seen, p.euler, at_points, f, false, lost);
  p.lost[k] = lost;
}

// to[k, c] <- from[c, k] up_c / down_c for k < scenes and c < columns; up and down have `width` entries.
__global__ void turn(const double* from, Index columns, Index scenes, const double* up, const double* down, Index width,
                     double* to) {
  __shared__ double block[tile][tile + 1];
  const Index c0 = Index(blockIdx.y) * tile, k0 = Index(blockIdx.x) * tile;
  for (Index i = threadIdx.y; i < tile; i += blockDim.y)
    if (c0 + i < columns && k0 + Index(threadIdx.x) < scenes)
      block[i][threadIdx.x] = from[(c0 + i) * scenes + k0 + Index(threadIdx.x)];
  __syncthreads();
  const Index c = c0 + Index(threadIdx.x);
  if (c >= columns) return;
  const double by = up[c % width], over = down[c % width];
  for (Index i = threadIdx.y; i < tile; i += blockDim.y)
    if (k0 + i < scenes) to[(k0 + i) * columns + c] = block[threadIdx.x][i] * by / over;
}

struct Kernels {
  void (*march)(Given);
  void (*check)(Given);
};

template <Index m, Index n>
constexpr Kernels kernels_of() {
  return {march_scenes<m, n>, check_scenes<m, n>};
}

template <Index m>
Kernels kernels_for(Index n) {
  constexpr Kernels all[] = {kernels_of<m, 1>(), kernels_of<m, 2>(), kernels_of<m, 3>(), kernels_of<m, 4>()};
  return all[n - 1];
}

Kernels general_kernels(Index n) {
  constexpr Kernels all[] = {kernels_of<0, 1>(), kernels_of<0, 2>(), kernels_of<0, 3>(), kernels_of<0, 4>(),
                             kernels_of<0, 5>(), kernels_of<0, 6>(), kernels_of<0, 7>(), kernels_of<0, 8>()};
  return all[n - 1];
}

Kernels choose(Index m, Index n) {
  constexpr Kernels (*small[])(Index) = {kernels_for<1>, kernels_for<2>, kernels_for<3>, kernels_for<4>};
  return m <= 4 && n <= 4 ? small[m - 1](n) : general_kernels(n);
}

// Tables of the host in one block of device memory, copied at once.
class TableBlock {
 public:
  // `to` points to the table on the device after `upload`.
  template <class Table>
  void add(const Table& table, const double*& to) {
    places_.push_back({&to, host_.size()});
    host_.insert(host_.end(), table.data(), table.data() + table.size());
  }
  void upload(const Device& device) {
    memory_ = Memory<double>(device, host_.size());
    memory_.put(host_.data());
    for (const Place& place : places_) *place.to = memory_.data() + place.first;
    places_.clear();
    host_ = {};
  }
  std::size_t bytes() const { return memory_.bytes(); }

 private:
  struct Place {
    const double** to;
    std::size_t first;
  };
  std::vector<Place> places_;
  std::vector<double> host_;
  Memory<double> memory_;
};

class DeviceSceneMarch final : public SceneMarch {
 public:
  DeviceSceneMarch(const Device& device, const SceneMarchProblem& p, Index scenes)
      : device_(device),
        m_(p.m),
        n_(p.n),
        rows_(p.J + 1),
        scenes_(scenes),
        kernels_(choose(p.m, p.n)),
        x0_(device, std::size_t(m_ * scenes)),
        y0_(device, std::size_t(n_ * scenes)),
        x_(device, std::size_t(rows_ * m_ * scenes)),
        y_(device, std::size_t(rows_ * n_ * scenes)),
        residual_(device, std::size_t(scenes)),
        lost_(device, std::size_t(scenes)),
        known_(device, std::size_t(scenes)),
        rows_of_y_(device, scenes * rows_, n_),
        side_(device.side_streams().take()) {
    Matrices<double>& s = given_.matrices;
    s.m = m_, s.J = p.J, s.h = p.h;
    s.surely_P = p.surely_P, s.stages = p.stages, s.most_growth = p.most_growth;
    const auto keep = [&](const auto& table, const double*& to) { tables_.add(table, to); };
    keep(p.E, s.E), keep(p.L, s.L), keep(p.R, s.R), keep(p.N, s.N), keep(p.M, s.M), keep(p.B, s.B);
    keep(p.growth_E, s.growth_E), keep(p.growth_G, s.growth_G);
    keep(p.size_of_E, s.size_of_E), keep(p.size_of_R, s.size_of_R), keep(p.part, s.part);
    keep(powers(p.y_unit, 1, n_), s.y_unit), keep(powers(p.w_unit, 1, n_), s.w_unit);
    for (const auto& [from, to] : {std::pair(&p.steps, &given_.steps), std::pair(&p.growth, &given_.growth)}) {
      keep(from->V, to->V), keep(from->rows, to->rows), keep(from->columns, to->columns);
      to->all_solutions = from->all_solutions;
    }
    keep(p.longest, given_.longest), keep(p.drift, given_.drift), keep(p.g, given_.g);
    keep(p.at_points, given_.at_points), keep(p.growth_drift, given_.growth_drift), keep(p.f, given_.f);
    keep(p.seen, given_.seen);
    if (p.euler.size() > 0) keep(p.euler, given_.euler);
    keep(factors(p.x_unit, 1, m_), x_up_), keep(factors(p.x_unit, -1, m_), x_down_);
    keep(factors(p.y_unit, 1, n_), y_up_), keep(factors(p.y_unit, -1, n_), y_down_);
    tables_.upload(device);
    given_.rigid = p.rigid;
    given_.x0 = x0_.data(), given_.y0 = y0_.data();
    given_.x = x_.data(), given_.y = y_.data(), given_.residual = residual_.data();
    given_.lost = lost_.data(), given_.known = known_.data();
  }
  ~DeviceSceneMarch() override {
    join();
    device_.side_streams().give_back(side_);
  }
  DeviceSceneMarch(const DeviceSceneMarch&) = delete;
  DeviceSceneMarch& operator=(const DeviceSceneMarch&) = delete;

  void start(const RowMatrix& x0, const RowMatrix& y0, const std::vector<char>& known) override {
    join();
    given_.scenes = x0.rows();
    const cudaStream_t stream = device_.stream();
    device_.fetcher().send(x0.data(), std::size_t(x0.size()), x0_.data(), stream);
    device_.fetcher().send(y0.data(), std::size_t(y0.size()), y0_.data(), stream);
    check(cudaMemcpyAsync(known_.data(), known.data(), known.size(), cudaMemcpyHostToDevice, stream),
          "copying scenes to the device");
    device_.wait();
    device_.note_work();
    const auto blocks = unsigned((given_.scenes + threads - 1) / threads);
    kernels_.march<<<blocks, threads, 0, stream>>>(given_);
    check(cudaGetLastError(), "stepping scenes");
    check(cudaEventRecord(side_.begun, stream), "stepping scenes");
    check(cudaStreamWaitEvent(side_.stream, side_.begun, 0), "stepping scenes");
    kernels_.check<<<blocks, threads, 0, side_.stream>>>(given_);
    check(cudaGetLastError(), "checking scenes");
    check(cudaEventRecord(side_.ended, side_.stream), "checking scenes");
    checks_ = true;
    turn_around(y_, n_, y_up_, y_down_, rows_of_y_);
    has_rows_of_x_ = false;
  }

  SceneMarchOutcome outcome() override {
    const Index K = given_.scenes;
    std::vector<unsigned char> lost(std::size_t(K), 0);
    SceneMarchOutcome outcome{std::vector<char>(std::size_t(K)), Vector(K)};
    join();
    get(lost_, lost.data(), K);
    get(residual_, outcome.residual.data(), K);
    device_.wait();
    for (std::size_t k = 0; k < lost.size(); ++k) outcome.settled[k] = !lost[k];
    return outcome;
  }

  const Array& x() override {
    if (!rows_of_x_) rows_of_x_.emplace(device_, scenes_ * rows_, m_);
    if (!has_rows_of_x_) turn_around(x_, m_, x_up_, x_down_, *rows_of_x_);
    has_rows_of_x_ = true;
    return *rows_of_x_;
  }
  const Array& y() override { return rows_of_y_; }

  std::size_t bytes() const override {
    return x0_.bytes() + y0_.bytes() + (rows_of_x_ ? 2 : 1) * x_.bytes() + 2 * y_.bytes() + residual_.bytes() +
           lost_.bytes() + known_.bytes() + tables_.bytes();
  }

 private:
  // 10^k, and 1 for the other sign: a number times 10^k is rounded once.
  static Vector factors(const std::vector<int>& k, int sign, Index n) {
    Vector all = Vector::Ones(n);
    for (Index i = 0; i < n && !k.empty(); ++i)
      if (sign * k[std::size_t(i)] > 0) all[i] = times_ten_to(sign * k[std::size_t(i)], 1);
    return all;
  }
  static Vector powers(const std::vector<int>& k, int sign, Index n) {
    Vector all = Vector::Ones(n);
    for (Index i = 0; i < n && !k.empty(); ++i) all[i] = times_ten_to(sign * k[std::size_t(i)], 1);
    return all;
  }

  // Later work of the main stream comes after the checks.
  void join() {
    if (checks_) cudaStreamWaitEvent(device_.stream(), side_.ended, 0);
    checks_ = false;
  }

  template <class T>
  void get(const Memory<T>& from, T* to, Index count) {
    check(cudaMemcpyAsync(to, from.data(), std::size_t(count) * sizeof(T), cudaMemcpyDeviceToHost, device_.stream()),
          "copying outcomes from the device");
  }

  void turn_around(const Memory<double>& from, Index width, const double* up, const double* down, DeviceArray& to) {
    const Index columns = rows_ * width;
    const dim3 blocks(unsigned((given_.scenes + tile - 1) / tile), unsigned((columns + tile - 1) / tile));
    turn<<<blocks, dim3(tile, 8), 0, device_.stream()>>>(from.data(), columns, given_.scenes, up, down, width,
                                                         to.memory.data());
    check(cudaGetLastError(), "ordering the rows of scenes");
  }

  const Device& device_;
  Index m_, n_, rows_, scenes_;
  Kernels kernels_;
  Given given_{};
  Memory<double> x0_, y0_, x_, y_, residual_;
  Memory<unsigned char> lost_, known_;
  std::optional<DeviceArray> rows_of_x_;  // made by the first call of x()
  DeviceArray rows_of_y_;
  SideStream side_;
  bool has_rows_of_x_ = false;  // of the last start
  bool checks_ = false;         // those of the last start may still run
  TableBlock tables_;
  const double *x_up_ = nullptr, *x_down_ = nullptr, *y_up_ = nullptr, *y_down_ = nullptr;
};

}  // namespace

std::unique_ptr<SceneMarch> make_scene_march(const Device& device, const SceneMarchProblem& problem, Index scenes) {
  const Index u = problem.stages ? 2 * problem.n : problem.n;
  const bool fits = problem.m >= 1 && problem.m <= 8 && u >= 1 && u <= scene_steps::most_unknowns;
  const Index blocks = ((problem.J + 1) * std::max(problem.m, problem.n) + tile - 1) / tile;
  if (!fits || blocks > 65535 || scenes < 1) return nullptr;  // rows of up to 8 numbers lie one after the other
  return std::make_unique<DeviceSceneMarch>(device, problem, scenes);
}

}  // namespace bromwich::cuda

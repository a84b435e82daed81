// Many small dense scenes, one thread each (core/host/scene_steps.hpp). Numbers of neighbouring threads are adjacent
// in memory, tables too where each scene has its own. One kernel makes the maps of all active sets, one takes the
// steps, one transposes the results into rows of scenes, in the units of the scenes. The checks are a kernel of another
// stream and run while the rows are copied to the host.

#include "core/host/scene_steps.hpp"
#include "core/host/set_map.hpp"
#include "core/host/stored_problem.hpp"
#include "core/scene/natural_units.hpp"
#include "core/seam/scene_march.hpp"
#include "kernels/parts.hpp"

#include <cmath>
#include <cstdint>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

namespace bromwich::cuda {

namespace {

using scene_steps::map_of_set;
using scene_steps::Matrices;
using scene_steps::most_states;
using scene_steps::PlanLayout;
using scene_steps::PlanTable;
using scene_steps::Rows;
using scene_steps::Sets;
using scene_steps::Source;
using scene_steps::SourceMap;
using scene_steps::Steps;
using scene_steps::StoredProblem;
using scene_steps::Strided;

constexpr int threads = 64;
constexpr int tile = 32;

// Tables that all scenes share, and those of scene k where each has its own.
__device__ const double* of_scene(const double* shared, Index) { return shared; }
__device__ Strided of_scene(Strided all, Index k) { return {all.base + k, all.apart}; }

template <class Table>
struct Given {
  Matrices<Table> matrices;
  Sets<Table> steps, growth;
  Table drift_map, q_map, growth_map, g_scale;
  Index driven_by;  // k
  const double *drift, *g, *at_points, *growth_drift, *f, *driven, *seen, *euler;
  unsigned rigid;
  Index scenes;
  const double *x0, *y0;  // rows of scenes
  double *x, *y, *residual;
  int* runs;                   // scenes x 2^n
  unsigned char* lost;         // not settled
  const unsigned char* known;  // other solutions are
};

template <class Table>
__device__ Sets<Table> of_scene(const Sets<Table>& all, Index k) {
  return {of_scene(all.V, k), of_scene(all.rows, k), of_scene(all.columns, k), all.all_solutions};
}

template <class Table>
__device__ Matrices<Table> of_scene(const Matrices<Table>& all, Index k) {
  Matrices<Table> own = all;
  for (Table* table : {&own.E, &own.L, &own.R, &own.N, &own.M, &own.B, &own.growth_E, &own.growth_G, &own.size_of_E,
                       &own.size_of_R, &own.y_unit, &own.w_unit})
    *table = of_scene(*table, k);
  return own;
}

// A source of scene k: a shared table, scaled where scenes have their own units, and what `samples` make by `map`.
template <class Table>
__device__ Source<double, Table> source_of(const Given<Table>& p, Index k, const double* table, Index width,
                                           bool scaled, Table map, const double* samples, Index length) {
  return {table, {}, width, 1, {of_scene(map, k), of_scene(p.g_scale, k), samples, length, scaled}};
}

template <Index m, Index n, class Table>
__device__ Steps<m, n, double, Table> steps_of(const Given<Table>& p, const Matrices<Table>& own, Index k) {
  const Index states = own.m, q = own.stages ? 2 * n : n, length = p.driven_by;
  const auto drift = source_of<Table>(p, k, p.drift, states, false, p.drift_map, p.driven, 2 * length);
  const bool scaled = own.stages && !p.drift && std::is_same_v<Table, Strided>;
  return {own,
          {p.x + k, states, p.scenes},
          {p.y + k, n, p.scenes},
          drift,
          source_of<Table>(p, k, p.g, q, scaled, p.q_map, p.driven, own.stages ? 2 * length : 0),
          own.stages ? source_of<Table>(p, k, p.growth_drift, states, false, p.growth_map, p.f, length) : drift};
}

template <Index m, Index n, class Table>
__global__ void __launch_bounds__(threads) march_scenes(const Given<Table> p) {
  const Index k = Index(blockIdx.x) * threads + threadIdx.x;
  if (k >= p.scenes) return;
  const Matrices<Table> own = of_scene(p.matrices, k);
  const auto steps = steps_of<m, n>(p, own, k);
  for (Index i = 0; i < steps.m(); ++i) steps.x(0, i) = p.x0[k * steps.m() + i];
  for (Index i = 0; i < n; ++i) steps.y(0, i) = p.y0[k * n + i];
  bool lost = false;
  StoredProblem<Table> problem{of_scene(p.steps, k)};
  if (own.stages) {
    if constexpr (2 * n <= scene_steps::most_unknowns)
      steps.march_stages(problem, p.rigid, lost,
                         [](Index, bool odd, const double*, double*, double*, double*, bool& gone) { gone |= odd; });
  } else {
    for (Index i = 0; i < n; ++i) problem.set |= steps.y(0, i) > 0 ? 1u << i : 0u;
    steps.march(problem, lost, [](Index, double*, double*) { return false; });
  }
  p.lost[k] = lost;
}

template <Index m, Index n, class Table>
__global__ void __launch_bounds__(threads) check_scenes(const Given<Table> p) {
  const Index k = Index(blockIdx.x) * threads + threadIdx.x;
  if (k >= p.scenes) return;
  bool lost = p.lost[k];
  const Matrices<Table> own = of_scene(p.matrices, k);
  const auto steps = steps_of<m, n>(p, own, k);
  const bool scaled = own.stages && !p.drift && std::is_same_v<Table, Strided>;
  const auto at_points = source_of<Table>(p, k, p.at_points, n, scaled, {}, nullptr, 0);
  double largest_x[m > 0 ? m : most_states];
  p.residual[k] = steps.check_rows(at_points, largest_x, lost);
  if (!lost) {
    StoredProblem<Table> growth{of_scene(p.growth, k), nullptr, 0, {p.runs + (k << n), 1}};
    steps.check_growth(growth, largest_x, lost);
  }
  if constexpr (std::is_same_v<Table, const double*>) {
    const auto f = source_of<Table>(p, k, p.f, own.m, false, {}, nullptr, 0);
    if (!lost && p.euler && !p.known[k]) steps.check_others(p.seen, p.euler, at_points, f, false, lost);
  }
  p.lost[k] = lost;
}

// V of active set `set` of plan k: the first number is NaN where it is not usable.
template <class Table>
__global__ void make_sets(Index plans, Index u, Table scaled, Table rows, Table judged, bool is_judged, double* V) {
  const Index thread = Index(blockIdx.x) * blockDim.x + threadIdx.x, k = thread % plans, set = thread / plans;
  if (set >= Index(1) << u) return;
  const Index apart = plans, first = set * u * u;
  const auto entry = [&](Index i) -> double& { return V[(first + i) * apart + k]; };
  const bool usable = (!is_judged || scene_steps::set_has_positive_pivots(u, unsigned(set), of_scene(judged, k))) &&
                      map_of_set(u, unsigned(set), of_scene(scaled, k), of_scene(rows, k), entry);
  if (!usable) entry(0) = NAN;
}

// Rows of scenes, to[k, c] <- from[column of c, k] up_c / down_c for k < scenes and c < columns: `width` of each of the
// given time points. up and down have `width` entries.
template <class Table>
__global__ void turn(const double* from, const Index* points, Index columns, Index scenes, Table up, Table down,
                     Index width, double* to) {
  __shared__ double block[tile][tile + 1];
  const Index c0 = Index(blockIdx.y) * tile, k0 = Index(blockIdx.x) * tile;
  for (Index i = threadIdx.y; i < tile; i += blockDim.y)
    if (c0 + i < columns && k0 + Index(threadIdx.x) < scenes)
      block[i][threadIdx.x] =
          from[(points[(c0 + i) / width] * width + (c0 + i) % width) * scenes + k0 + Index(threadIdx.x)];
  __syncthreads();
  const Index c = c0 + Index(threadIdx.x);
  if (c >= columns) return;
  for (Index i = threadIdx.y; i < tile; i += blockDim.y) {
    const Index k = k0 + i;
    if (k < scenes)
      to[k * columns + c] = block[threadIdx.x][i] * of_scene(up, k)[c % width] / of_scene(down, k)[c % width];
  }
}

// to[c, k] <- from[k, c] for k < rows and c < columns.
__global__ void transpose(const double* from, Index rows, Index columns, double* to) {
  __shared__ double block[tile][tile + 1];
  const Index k0 = Index(blockIdx.x) * tile, c0 = Index(blockIdx.y) * tile;
  for (Index i = threadIdx.y; i < tile; i += blockDim.y)
    if (k0 + i < rows && c0 + Index(threadIdx.x) < columns)
      block[i][threadIdx.x] = from[(k0 + i) * columns + c0 + Index(threadIdx.x)];
  __syncthreads();
  for (Index i = threadIdx.y; i < tile; i += blockDim.y)
    if (c0 + i < columns && k0 + Index(threadIdx.x) < rows)
      to[(c0 + i) * rows + k0 + Index(threadIdx.x)] = block[threadIdx.x][i];
}

template <class Table>
struct Kernels {
  void (*march)(Given<Table>);
  void (*check)(Given<Table>);
};

template <Index m, Index n, class Table>
constexpr Kernels<Table> kernels_of() {
  return {march_scenes<m, n, Table>, check_scenes<m, n, Table>};
}

template <class Table>
Kernels<Table> general_kernels(Index n) {
  constexpr Kernels<Table> all[] = {kernels_of<0, 1, Table>(), kernels_of<0, 2, Table>(), kernels_of<0, 3, Table>(),
                                    kernels_of<0, 4, Table>(), kernels_of<0, 5, Table>(), kernels_of<0, 6, Table>(),
                                    kernels_of<0, 7, Table>(), kernels_of<0, 8, Table>()};
  return all[n - 1];
}

template <Index m>
Kernels<const double*> kernels_for(Index n) {
  using Table = const double*;
  constexpr Kernels<Table> all[] = {kernels_of<m, 1, Table>(), kernels_of<m, 2, Table>(), kernels_of<m, 3, Table>(),
                                    kernels_of<m, 4, Table>()};
  return all[n - 1];
}

// Tables that are read from memory in each step leave little to gain from sizes that the compiler knows.
Kernels<Strided> choose(Index, Index n, Strided) { return general_kernels<Strided>(n); }
Kernels<const double*> choose(Index m, Index n, const double*) {
  constexpr Kernels<const double*> (*small[])(Index) = {kernels_for<1>, kernels_for<2>, kernels_for<3>, kernels_for<4>};
  return m <= 4 && n <= 4 ? small[m - 1](n) : general_kernels<const double*>(n);
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

template <class Table>
class DeviceSceneMarch final : public SceneMarch {
  static constexpr bool own_plans = std::is_same_v<Table, Strided>;

 public:
  DeviceSceneMarch(const Device& device, const SceneMarchProblem& p, Index scenes)
      : device_(device),
        layout_(p.layout),
        rows_(Index(p.rows.size())),
        scenes_(scenes),
        judged_(p.judged),
        kernels_(choose(p.layout.m, p.layout.n, Table{})),
        plans_(device, std::size_t(layout_.at(PlanTable::count) * (own_plans ? scenes : 1))),
        step_maps_(device, std::size_t(size_of_maps(layout_.unknowns()) * (own_plans ? scenes : 1))),
        growth_maps_(device, std::size_t(layout_.stages ? size_of_maps(layout_.n) * (own_plans ? scenes : 1) : 0)),
        x0_(device, std::size_t(m() * scenes)),
        y0_(device, std::size_t(n() * scenes)),
        x_(device, std::size_t((p.J + 1) * m() * scenes)),
        y_(device, std::size_t((p.J + 1) * n() * scenes)),
        points_(device, p.rows.size()),
        residual_(device, std::size_t(scenes)),
        runs_(device, std::size_t(scenes << n())),
        lost_(device, std::size_t(scenes)),
        known_(device, std::size_t(scenes)),
        rows_of_y_(device, scenes * rows_, n()),
        side_(device.side_streams().take()) {
    Matrices<Table>& s = given_.matrices;
    s.m = m(), s.J = p.J, s.h = p.h;
    s.surely_P = p.surely_P, s.stages = layout_.stages, s.most_growth = p.most_growth;
    given_.steps.all_solutions = p.certain;
    given_.driven_by = layout_.k;
    const auto keep = [&](const auto& table, const double*& to) {
      if (table.size() > 0) tables_.add(table, to);
    };
    keep(p.part, s.part), keep(p.drift, given_.drift), keep(p.g, given_.g), keep(p.at_points, given_.at_points);
    keep(p.growth_drift, given_.growth_drift), keep(p.f, given_.f), keep(p.driven, given_.driven);
    keep(p.seen, given_.seen), keep(p.euler, given_.euler);
    tables_.upload(device);
    points_.put(p.rows.data());
    given_.rigid = p.rigid;
    given_.x0 = x0_.data(), given_.y0 = y0_.data();
    given_.x = x_.data(), given_.y = y_.data(), given_.residual = residual_.data(), given_.runs = runs_.data();
    given_.lost = lost_.data(), given_.known = known_.data();
    if (own_plans) return;
    plans_.put(p.plan.data());
    take_plans(1);
  }
  ~DeviceSceneMarch() override {
    join();
    device_.side_streams().give_back(side_);
  }
  DeviceSceneMarch(const DeviceSceneMarch&) = delete;
  DeviceSceneMarch& operator=(const DeviceSceneMarch&) = delete;

  void start(const RowMatrix& x0, const RowMatrix& y0, const std::vector<char>& known,
             const RowMatrix& plans) override {
    join();
    given_.scenes = x0.rows();
    const cudaStream_t stream = device_.stream();
    device_.fetcher().send(x0.data(), std::size_t(x0.size()), x0_.data(), stream);
    device_.fetcher().send(y0.data(), std::size_t(y0.size()), y0_.data(), stream);
    check(cudaMemcpyAsync(known_.data(), known.data(), known.size(), cudaMemcpyHostToDevice, stream),
          "copying scenes to the device");
    if (own_plans) {
      Memory<double> rows(device_, std::size_t(plans.size()));
      device_.fetcher().send(plans.data(), std::size_t(plans.size()), rows.data(), stream);
      const dim3 blocks(unsigned((plans.rows() + tile - 1) / tile), unsigned((plans.cols() + tile - 1) / tile));
      transpose<<<blocks, dim3(tile, 8), 0, stream>>>(rows.data(), plans.rows(), plans.cols(), plans_.data());
      check(cudaGetLastError(), "ordering the plans of scenes");
      take_plans(given_.scenes);
    }
    runs_.clear();
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
    turn_around(y_, n(), PlanTable::y_up, PlanTable::y_down, rows_of_y_);
    has_rows_of_x_ = false;
  }

  SceneMarchOutcome outcome() override {
    const std::size_t K = std::size_t(given_.scenes);
    std::vector<unsigned char> lost(K, 0);
    SceneMarchOutcome outcome{std::vector<char>(K), Vector(given_.scenes), std::vector<int>(K << n())};
    join();
    get(lost_, lost.data(), K);
    get(residual_, outcome.residual.data(), K);
    get(runs_, outcome.runs.data(), outcome.runs.size());
    device_.wait();
    for (std::size_t k = 0; k < K; ++k) outcome.settled[k] = !lost[k];
    return outcome;
  }

  const Array& x() override {
    if (!rows_of_x_) rows_of_x_.emplace(device_, scenes_ * rows_, m());
    if (!has_rows_of_x_) turn_around(x_, m(), PlanTable::x_up, PlanTable::x_down, *rows_of_x_);
    has_rows_of_x_ = true;
    return *rows_of_x_;
  }
  const Array& y() override { return rows_of_y_; }

  std::size_t bytes() const override {
    return plans_.bytes() + step_maps_.bytes() + growth_maps_.bytes() + x0_.bytes() + y0_.bytes() +
           (rows_of_x_ ? 2 : 1) * x_.bytes() + 2 * y_.bytes() + residual_.bytes() + runs_.bytes() + lost_.bytes() +
           known_.bytes() + tables_.bytes();
  }

 private:
  static Index size_of_maps(Index u) { return (Index(1) << u) * u * u; }
  Index m() const { return layout_.m; }
  Index n() const { return layout_.n; }

  // Table `which` of all plans, `plans` of them side by side.
  Table table(PlanTable which) const {
    const double* first = plans_.data() + layout_.at(which) * count_;
    if constexpr (own_plans)
      return {first, count_};
    else
      return first;
  }
  Table maps(const Memory<double>& all) const {
    if constexpr (own_plans)
      return {all.data(), count_};
    else
      return all.data();
  }

  void take_plans(Index count) {
    count_ = count;
    Matrices<Table>& s = given_.matrices;
    s.E = table(PlanTable::E), s.L = table(PlanTable::L), s.R = table(PlanTable::R), s.N = table(PlanTable::N);
    s.M = table(PlanTable::M), s.B = table(PlanTable::B);
    s.growth_E = table(PlanTable::growth_E), s.growth_G = table(PlanTable::growth_G);
    s.size_of_E = table(PlanTable::size_of_E), s.size_of_R = table(PlanTable::size_of_R);
    s.y_unit = table(PlanTable::y_unit), s.w_unit = table(PlanTable::w_unit);
    given_.drift_map = table(PlanTable::drift_map), given_.q_map = table(PlanTable::q_map);
    given_.growth_map = table(PlanTable::growth_map), given_.g_scale = table(PlanTable::g_scale);
    make_maps(layout_.unknowns(), PlanTable::steps, PlanTable::step_rows, PlanTable::step_columns, step_maps_,
              given_.steps);
    given_.growth = given_.steps;
    if (layout_.stages)
      make_maps(n(), PlanTable::growth, PlanTable::growth_rows, PlanTable::growth_columns, growth_maps_, given_.growth);
  }

  void make_maps(Index u, PlanTable matrix, PlanTable rows, PlanTable columns, Memory<double>& to, Sets<Table>& sets) {
    sets.V = maps(to), sets.rows = table(rows), sets.columns = table(columns);
    const Index work = count_ << u;
    make_sets<<<unsigned((work + threads - 1) / threads), threads, 0, device_.stream()>>>(
        count_, u, table(matrix), table(rows), table(PlanTable::M), judged_, to.data());
    check(cudaGetLastError(), "making the maps of active sets");
  }

  // Later work of the main stream comes after the checks.
  void join() {
    if (checks_) cudaStreamWaitEvent(device_.stream(), side_.ended, 0);
    checks_ = false;
  }

  template <class T>
  void get(const Memory<T>& from, T* to, std::size_t count) {
    check(cudaMemcpyAsync(to, from.data(), count * sizeof(T), cudaMemcpyDeviceToHost, device_.stream()),
          "copying outcomes from the device");
  }

  void turn_around(const Memory<double>& from, Index width, PlanTable up, PlanTable down, DeviceArray& to) {
    const Index columns = rows_ * width;
    const dim3 blocks(unsigned((given_.scenes + tile - 1) / tile), unsigned((columns + tile - 1) / tile));
    turn<<<blocks, dim3(tile, 8), 0, device_.stream()>>>(from.data(), points_.data(), columns, given_.scenes, table(up),
                                                         table(down), width, to.memory.data());
    check(cudaGetLastError(), "ordering the rows of scenes");
  }

  const Device& device_;
  PlanLayout layout_;
  Index rows_, scenes_, count_ = 1;  ///< rows_: that are returned of a scene; count_: of plans
  bool judged_;
  Kernels<Table> kernels_;
  Given<Table> given_{};
  Memory<double> plans_, step_maps_, growth_maps_, x0_, y0_, x_, y_, residual_;
  Memory<Index> points_;
  Memory<int> runs_;
  Memory<unsigned char> lost_, known_;
  std::optional<DeviceArray> rows_of_x_;  // made by the first call of x()
  DeviceArray rows_of_y_;
  SideStream side_;
  bool has_rows_of_x_ = false;  // of the last start
  bool checks_ = false;         // those of the last start may still run
  TableBlock tables_;
};

}  // namespace

std::unique_ptr<SceneMarch> make_scene_march(const Device& device, const SceneMarchProblem& problem, Index scenes) {
  const PlanLayout& layout = problem.layout;
  const Index u = layout.unknowns();
  const bool fits = layout.m >= 1 && layout.m <= 8 && u >= 1 && u <= scene_steps::most_unknowns;
  const Index blocks = (Index(problem.rows.size()) * std::max(layout.m, layout.n) + tile - 1) / tile;
  if (!fits || blocks > 65535 || scenes < 1) return nullptr;  // rows of up to 8 numbers lie one after the other
  if (problem.plan.size() > 0) return std::make_unique<DeviceSceneMarch<const double*>>(device, problem, scenes);
  return std::make_unique<DeviceSceneMarch<Strided>>(device, problem, scenes);
}

}  // namespace bromwich::cuda

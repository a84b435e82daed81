// Many small dense scenes, one thread each (core/batch/scene_steps.hpp): steps and checks of a scene run in one kernel,
// numbers of neighbouring threads lie side by side. A second kernel turns rows of scenes around and gives them the
// units of the scenes.

#include "core/batch/scene_steps.hpp"
#include "core/scene/natural_units.hpp"
#include "core/seam/scene_march.hpp"
#include "kernels/parts.hpp"

#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

namespace bromwich::cuda {

namespace {

using scene_steps::Matrices;
using scene_steps::most_states;
using scene_steps::Rows;
using scene_steps::Source;
using scene_steps::Steps;

constexpr int threads = 64;
constexpr int tile = 32;

struct Sets {
  const double *V, *rows, *columns;
  bool all_solutions;
};

// The problem of a scene, which keeps its active set from step to step.
struct StoredProblem {
  Sets sets;
  const double* longest;  // null: no limits
  unsigned set = 0;

  template <Index u>
  constexpr double row_times(const double* q, Index i) const {
    const double* v = sets.V + (Index(set) * u + i) * u;
    double sum = 0;
    for (Index k = 0; k < u; ++k) sum += v[k] * q[k];
    return sum;
  }
  template <Index u>
  constexpr bool usable() const {
    return sets.V[Index(set) * u * u] == sets.V[Index(set) * u * u];
  }
  constexpr bool active(Index i) const { return set >> i & 1u; }

  // Semismooth Newton, as ActiveSetTable::solve. A cycle uses up its sweeps.
  template <Index u>
  constexpr bool newton(const double* q, double largest, double* value) {
    for (int sweep = 0; sweep < 12 + int(u); ++sweep) {
      if (!usable<u>()) return false;
      unsigned flips = 0;
      const double* v = sets.V + Index(set) * u * u;
      for (Index i = 0; i < u; ++i) {
        double sum = 0, terms = 0;
        for (Index k = 0; k < u; ++k) {
          const double term = v[i * u + k] * q[k];
          sum += term;
          terms += term < 0 ? -term : term;
        }
        value[i] = sum;
        if (sum < -16 * epsilon * largest && sum < -16 * epsilon * terms) flips |= 1u << i;
      }
      if (flips == 0) return true;
      set ^= flips;
    }
    return false;
  }

  template <Index u>
  constexpr void take_value(const double* value, double* y) const {
    for (Index i = 0; i < u; ++i) {
      const double own = value[i] * sets.columns[i];
      y[i] = active(i) && own > 0 ? own : 0;
    }
  }

  template <Index u>
  constexpr double largest_of(const double* q) const {
    double largest = 0;
    for (Index i = 0; i < u; ++i) {
      const double size = (q[i] < 0 ? -q[i] : q[i]) * sets.rows[i];
      largest = size > largest ? size : largest;
    }
    return largest;
  }

  template <Index u>
  constexpr void solve(const double* q, double* y, bool& lost) {
    double value[u] = {};
    const double largest = largest_of<u>(q);
    if (!lost && !newton<u>(q, largest, value)) lost = true;
    take_value<u>(value, y);
  }

  template <Index u>
  constexpr void try_stages(const double* q, double* y, bool& uncertain) {
    double value[u] = {};
    const double largest = largest_of<u>(q);
    bool certain = newton<u>(q, largest, value);
    double least = INFINITY, most = 0;
    for (Index i = 0; i < u; ++i) {
      const double size = value[i] < 0 ? -value[i] : value[i];
      least = value[i] < least ? value[i] : least;
      most = size > most ? size : most;
    }
    certain = certain && (sets.all_solutions || least > 2e-10 * (largest + double(2 * u) * most));
    uncertain = uncertain || !certain;
    take_value<u>(value, y);
  }

  template <Index u>
  constexpr void take(const double* y, bool& lost) {
    set = 0;
    for (Index i = 0; i < u; ++i) set |= y[i] > 0 ? 1u << i : 0u;
    if (!usable<u>()) lost = true;
  }

  template <Index u>
  constexpr void respond(const double* v, double* to) const {
    for (Index i = 0; i < u; ++i) to[i] = active(i) ? sets.columns[i] * row_times<u>(v, i) : 0;
  }

  constexpr double limit() const { return longest[set]; }
};

struct Given {
  Matrices<double> matrices;
  Sets steps, growth;
  const double *longest, *drift, *g, *at_points, *growth_drift, *f, *seen, *euler;
  unsigned rigid;
  Index scenes;
  double *x, *y, *residual;
  unsigned char* lost;         // in: known to be lost; out: not settled
  const unsigned char* known;  // other solutions are
};

template <Index m, Index n>
__global__ void __launch_bounds__(threads) march_scenes(const Given p) {
  const Index k = Index(blockIdx.x) * threads + threadIdx.x;
  if (k >= p.scenes) return;
  bool lost = p.lost[k];
  const Index states = p.matrices.m;
  const Source<double> drift{p.drift, nullptr, states, 1}, g{p.g, nullptr, p.matrices.stages ? 2 * n : n, 1},
      at_points{p.at_points, nullptr, n, 1}, growth_drift{p.growth_drift, nullptr, states, 1},
      f{p.f, nullptr, states, 1};
  const Steps<m, n, double, double> steps{p.matrices,  {p.x + k, states, p.scenes}, {p.y + k, n, p.scenes}, drift, g,
                                          growth_drift};
  StoredProblem problem{p.steps, nullptr};
  if (p.matrices.stages) {
    if constexpr (2 * n <= scene_steps::most_unknowns)
      steps.march_stages(problem, p.rigid, lost,
                         [](Index, bool odd, const double*, double*, double*, double*, bool& gone) { gone |= odd; });
  } else {
    for (Index i = 0; i < n; ++i) problem.set |= steps.y(0, i) > 0 ? 1u << i : 0u;
    steps.march(problem, lost, [](Index, double*, double*) { return false; });
  }
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

using Kernel = void (*)(Given);

template <Index m>
Kernel kernel_of(Index n) {
  constexpr Kernel all[] = {march_scenes<m, 1>, march_scenes<m, 2>, march_scenes<m, 3>, march_scenes<m, 4>};
  return all[n - 1];
}

Kernel general_kernel(Index n) {
  constexpr Kernel all[] = {march_scenes<0, 1>, march_scenes<0, 2>, march_scenes<0, 3>, march_scenes<0, 4>,
                            march_scenes<0, 5>, march_scenes<0, 6>, march_scenes<0, 7>, march_scenes<0, 8>};
  return all[n - 1];
}

Kernel choose(Index m, Index n) {
  constexpr Kernel (*small[])(Index) = {kernel_of<1>, kernel_of<2>, kernel_of<3>, kernel_of<4>};
  return m <= 4 && n <= 4 ? small[m - 1](n) : general_kernel(n);
}

class DeviceSceneMarch final : public SceneMarch {
 public:
  DeviceSceneMarch(const Device& device, const SceneMarchProblem& p, Index scenes)
      : device_(device),
        m_(p.m),
        n_(p.n),
        rows_(p.J + 1),
        scenes_(scenes),
        kernel_(choose(p.m, p.n)),
        x_(device, std::size_t(rows_ * m_ * scenes)),
        y_(device, std::size_t(rows_ * n_ * scenes)),
        residual_(device, std::size_t(scenes)),
        lost_(device, std::size_t(scenes)),
        known_(device, std::size_t(scenes)),
        rows_of_x_(device, scenes * rows_, m_),
        rows_of_y_(device, scenes * rows_, n_) {
    Matrices<double>& s = given_.matrices;
    s.m = m_, s.J = p.J, s.h = p.h;
    s.E = keep(p.E), s.L = keep(p.L), s.R = keep(p.R), s.N = keep(p.N), s.M = keep(p.M), s.B = keep(p.B);
    s.growth_E = keep(p.growth_E), s.growth_G = keep(p.growth_G);
    s.size_of_E = keep(p.size_of_E), s.size_of_R = keep(p.size_of_R);
    s.part = keep(p.part);
    s.y_unit = keep(powers(p.y_unit, 1, n_)), s.w_unit = keep(powers(p.w_unit, 1, n_));
    s.surely_P = p.surely_P, s.stages = p.stages, s.most_growth = p.most_growth;
    given_.steps = keep(p.steps), given_.growth = keep(p.growth);
    given_.longest = keep(p.longest), given_.drift = keep(p.drift), given_.g = keep(p.g);
    given_.at_points = keep(p.at_points), given_.growth_drift = keep(p.growth_drift), given_.f = keep(p.f);
    given_.seen = keep(p.seen), given_.euler = p.euler.size() > 0 ? keep(p.euler) : nullptr;
    given_.rigid = p.rigid;
    given_.x = x_.data(), given_.y = y_.data(), given_.residual = residual_.data();
    given_.lost = lost_.data(), given_.known = known_.data();
    x_up_ = keep(factors(p.x_unit, 1, m_)), x_down_ = keep(factors(p.x_unit, -1, m_));
    y_up_ = keep(factors(p.y_unit, 1, n_)), y_down_ = keep(factors(p.y_unit, -1, n_));
  }

  SceneMarchOutcome run(const RowMatrix& x0, const RowMatrix& y0, const std::vector<char>& known) override {
    const Index K = x0.rows();
    given_.scenes = K;
    put(RowMatrix(x0.transpose()), x_);
    put(RowMatrix(y0.transpose()), y_);
    std::vector<unsigned char> lost(std::size_t(K), 0), seen(known.begin(), known.end());
    put(lost, lost_);
    put(seen, known_);
    device_.note_work();
    kernel_<<<unsigned((K + threads - 1) / threads), threads, 0, device_.stream()>>>(given_);
    check(cudaGetLastError(), "stepping scenes");
    turn_around(x_, m_, x_up_, x_down_, rows_of_x_);
    turn_around(y_, n_, y_up_, y_down_, rows_of_y_);
    SceneMarchOutcome outcome{std::vector<char>(std::size_t(K)), Vector(K)};
    get(lost_, lost.data(), K);
    get(residual_, outcome.residual.data(), K);
    for (std::size_t k = 0; k < lost.size(); ++k) outcome.settled[k] = !lost[k];
    return outcome;
  }

  const Array& x() override { return rows_of_x_; }
  const Array& y() override { return rows_of_y_; }

  std::size_t bytes() const override {
    std::size_t sum = 2 * (x_.bytes() + y_.bytes()) + residual_.bytes() + lost_.bytes() + known_.bytes();
    for (const Memory<double>& table : tables_) sum += table.bytes();
    return sum;
  }

 private:
  template <class Table>
  const double* keep(const Table& table) {
    tables_.push_back(on_device(device_, table));
    return tables_.back().data();
  }
  Sets keep(const StoredSets& s) { return {keep(s.V), keep(s.rows), keep(s.columns), s.all_solutions}; }

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

  template <class Values, class T>
  void put(const Values& from, Memory<T>& to) {
    check(cudaMemcpyAsync(to.data(), from.data(), std::size_t(from.size()) * sizeof(T), cudaMemcpyHostToDevice,
                          device_.stream()),
          "copying scenes to the device");
    device_.wait();
  }
  template <class T>
  void get(const Memory<T>& from, T* to, Index count) {
    check(cudaMemcpyAsync(to, from.data(), std::size_t(count) * sizeof(T), cudaMemcpyDeviceToHost, device_.stream()),
          "copying outcomes from the device");
    device_.wait();
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
  Kernel kernel_;
  Given given_{};
  Memory<double> x_, y_, residual_;
  Memory<unsigned char> lost_, known_;
  DeviceArray rows_of_x_, rows_of_y_;
  std::vector<Memory<double>> tables_;
  const double *x_up_, *x_down_, *y_up_, *y_down_;
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

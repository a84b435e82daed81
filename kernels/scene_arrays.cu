// Many small dense scenes in arrays of the device, one thread each (core/host/held_steps.hpp). Their tables are those
// of core/seam/scene_arrays.hpp: the rows of a scene follow each other, and a row is a sector of memory.

#include "core/seam/scene_arrays.hpp"
#include "kernels/parts.hpp"

#include <cstddef>
#include <type_traits>
#include <utility>
#include <vector>

namespace bromwich::cuda {

namespace {

using scene_steps::HeldChecks;
using scene_steps::HeldGiven;
using scene_steps::HeldMatrices;
using scene_steps::HeldRows;
using scene_steps::HeldState;
using scene_steps::HeldSteps;

constexpr int threads = 64;

// A table of all scenes; `apart`: numbers from scene to scene, 0 where they share it.
template <class Number>
struct Tables {
  Number* base = nullptr;
  Index apart = 0;
  __device__ Number* of(Index k) const { return base ? base + k * apart : nullptr; }
};
using Read = Tables<const double>;
using Write = Tables<double>;

struct Given {
  HeldMatrices matrices;
  Index scenes;
  Read x0, f, g, y, x;
  HeldState* states;
  unsigned char* decided;
};

struct GivenChange {
  Read x0, f, g, matrices;
  Write y, x, w, integral;
};

struct GivenWeights {
  Read y, x, w, integral;
  Write x0, f, g, matrices;
};

__device__ Index scene_of_thread() { return Index(blockIdx.x) * threads + threadIdx.x; }

template <Index m, Index n>
__device__ HeldSteps<m, n> steps_of(const Given& p, Index k) {
  return {p.matrices, {p.f.of(k), p.matrices.m}, {p.g.of(k), n}};
}

template <Index m, Index n>
__global__ void __launch_bounds__(threads) solve_scenes(const Given p, const Write y) {
  const Index k = scene_of_thread();
  if (k >= p.scenes) return;
  HeldState state;
  steps_of<m, n>(p, k).solve(p.x0.of(k), HeldRows{y.of(k), n}, state);
  p.states[k] = state;
}

template <Index m, Index n>
__global__ void __launch_bounds__(threads) follow_scenes(const Given p, const Write x, const Write w) {
  const Index k = scene_of_thread();
  if (k >= p.scenes) return;
  HeldState state;
  steps_of<m, n>(p, k).follow(HeldGiven{p.y.of(k), n}, p.x0.of(k), HeldRows{x.of(k), p.matrices.m},
                              HeldRows{w.of(k), n}, state);
  p.states[k] = state;
}

template <Index m, Index n>
__global__ void __launch_bounds__(threads)
    doubt_scenes(const Given p, const HeldChecks checks, const Write y, const Write x, const Write drift) {
  const Index k = scene_of_thread();
  if (k >= p.scenes) return;
  const Index states = p.matrices.m;
  steps_of<m, n>(p, k).doubt(checks, HeldRows{y.of(k), n}, HeldRows{x.of(k), states}, HeldRows{drift.of(k), states},
                             p.states[k]);
}

template <Index m, Index n>
__global__ void __launch_bounds__(threads) change_scenes(const Given p, const GivenChange c) {
  const Index k = scene_of_thread();
  if (k >= p.scenes) return;
  p.decided[k] = 0;
  const HeldState state = p.states[k];
  if (state.verdict != HeldState::fine) return;
  const Index states = p.matrices.m;
  p.decided[k] =
      steps_of<m, n>(p, k).forward(HeldGiven{p.y.of(k), n}, HeldGiven{p.x.of(k), states}, state,
                                   {c.x0.of(k), {c.f.of(k), states}, {c.g.of(k), n}, c.matrices.of(k)},
                                   {{c.y.of(k), n}, {c.x.of(k), states}, {c.w.of(k), n}, {c.integral.of(k), n}});
}

template <Index m, Index n>
__global__ void __launch_bounds__(threads) weigh_scenes(const Given p, const GivenWeights c) {
  const Index k = scene_of_thread();
  if (k >= p.scenes) return;
  p.decided[k] = 0;
  const HeldState state = p.states[k];
  if (state.verdict != HeldState::fine) return;
  const Index states = p.matrices.m;
  p.decided[k] =
      steps_of<m, n>(p, k).backward(HeldGiven{p.y.of(k), n}, HeldGiven{p.x.of(k), states}, state,
                                    {{c.y.of(k), n}, {c.x.of(k), states}, {c.w.of(k), n}, {c.integral.of(k), n}},
                                    {c.x0.of(k), {c.f.of(k), states}, {c.g.of(k), n}, c.matrices.of(k)});
}

struct Kernels {
  void (*solve)(Given, Write);
  void (*follow)(Given, Write, Write);
  void (*doubt)(Given, HeldChecks, Write, Write, Write);
  void (*change)(Given, GivenChange);
  void (*weigh)(Given, GivenWeights);
};

template <Index m, Index n>
constexpr Kernels kernels_of() {
  return {solve_scenes<m, n>, follow_scenes<m, n>, doubt_scenes<m, n>, change_scenes<m, n>, weigh_scenes<m, n>};
}

template <Index m, Index... n>
Kernels chosen(Index size, std::integer_sequence<Index, n...>) {
  constexpr Kernels all[] = {kernels_of<m, n + 1>()...};
  return all[size - 1];
}

Kernels choose(Index m, Index n) {
  using Few = std::make_integer_sequence<Index, 4>;
  constexpr Kernels (*small[])(Index, Few) = {chosen<1>, chosen<2>, chosen<3>, chosen<4>};
  return m <= 4 && n <= 4 ? small[m - 1](n, Few()) : chosen<0>(n, std::make_integer_sequence<Index, 8>());
}

class DeviceSceneArrays final : public SceneArrays {
 public:
  DeviceSceneArrays(const Device& device, const SceneArraysProblem& p, Index scenes)
      : device_(device),
        rows_(p.J + 1),
        kernels_(choose(p.m, p.n)),
        states_(device, std::size_t(scenes)),
        decided_(device, std::size_t(scenes)) {
    const SceneArraysTables t(p);
    HeldMatrices& s = given_.matrices;
    s.m = p.m, s.n = p.n, s.J = p.J, s.h = p.h;
    std::vector<double> all;
    std::vector<std::pair<const double**, std::size_t>> places;
    const auto keep = [&](const auto& table, const double*& to) {
      places.push_back({&to, all.size()});
      all.insert(all.end(), table.data(), table.data() + table.size());
    };
    keep(p.E, s.E), keep(p.L, s.L), keep(p.R, s.R), keep(p.B, s.B), keep(p.N, s.N), keep(p.M, s.M);
    keep(t.left, s.left), keep(t.right, s.right);
    for (const auto& [from, to] : {std::pair(&p.steps, &s.steps), std::pair(&p.start, &s.start)}) {
      keep(from->V, to->V), keep(from->rows, to->rows), keep(from->columns, to->columns);
      to->all_solutions = from->all_solutions;
    }
    scene_steps::Matrices<const double*>& rows = checks_.rows;
    keep(t.growth_G, rows.growth_G), keep(t.size_of_E, rows.size_of_E), keep(t.size_of_R, rows.size_of_R);
    keep(t.part, rows.part), keep(t.ones, rows.y_unit), keep(t.zeros, checks_.zeros);
    if (p.longest.size() > 0) keep(p.longest, checks_.longest);
    tables_ = Memory<double>(device, all.size());
    tables_.put(all.data());
    for (const auto& [to, first] : places) *to = tables_.data() + first;
    rows.m = p.m, rows.J = p.J, rows.h = p.h, rows.most_growth = p.most_growth;
    rows.E = rows.growth_E = s.E, rows.L = s.left, rows.R = s.right, rows.N = s.N, rows.M = s.M, rows.B = s.B;
    rows.w_unit = rows.y_unit;
    if (checks_.longest) drift_ = Memory<double>(device, std::size_t(scenes * rows_ * p.m));
    given_.scenes = scenes;
    given_.states = states_.data(), given_.decided = decided_.data();
  }

  Index scenes() const override { return given_.scenes; }
  std::size_t bytes() const override { return tables_.bytes() + drift_.bytes() + states_.bytes() + decided_.bytes(); }

  States solve(const SceneSources& of, Array& y) override {
    take(of);
    launch("stepping scenes", kernels_.solve, given_, table(&y));
    return fetched(states_);
  }

  States follow(const SceneSources& of, Array& y, Array& x, Array& w) override {
    take(of);
    given_.y = read(&y, rows_), given_.x = read(&x, rows_);
    launch("following scenes", kernels_.follow, given_, table(&x), table(&w));
    if (checks_.longest)
      launch("checking scenes", kernels_.doubt, given_, checks_, table(&y), table(&x),
             Write{drift_.data(), rows_ * given_.matrices.m});
    return fetched(states_);
  }

  std::vector<char> forward(const SceneChange& c, const SceneRows<Array>& out) override {
    const GivenChange change{read(c.of.x0, 1), read(c.of.f, rows_), read(c.of.g, rows_), read(c.matrices, 1),
                             table(out.y),     table(out.x),        table(out.w),        table(out.integral)};
    launch("differentiating scenes", kernels_.change, given_, change);
    return decisions();
  }

  std::vector<char> backward(const SceneRows<const Array>& of, const SceneGradient& bar) override {
    const GivenWeights weights{read(of.y, rows_), read(of.x, rows_), read(of.w, rows_), read(of.integral, rows_),
                               table(bar.x0, 1),  table(bar.f),      table(bar.g),      table(bar.matrices, 1)};
    launch("differentiating scenes backward", kernels_.weigh, given_, weights);
    return decisions();
  }

 private:
  void take(const SceneSources& of) {
    given_.x0 = read(of.x0, 1), given_.f = read(of.f, rows_), given_.g = read(of.g, rows_);
  }

  // `rows`: of a scene. Arrays with no more are shared.
  static Read read(const Array* array, Index rows) {
    if (!array) return {};
    return {values(*array), array->rows() > rows ? rows * stride(array->cols()) : 0};
  }
  Write table(Array* array, Index rows = 0) const {
    if (!array) return {};
    return {values(*array), (rows > 0 ? rows : rows_) * stride(array->cols())};
  }

  template <class... Parameters>
  void launch(const char* what, void (*kernel)(Parameters...), const std::type_identity_t<Parameters>&... arguments) {
    const cudaStream_t stream = device_.stream();
    device_.note_work();
    kernel<<<unsigned((given_.scenes + threads - 1) / threads), threads, 0, stream>>>(arguments...);
    check(cudaGetLastError(), what);
  }

  template <class T>
  std::vector<T> fetched(const Memory<T>& from) const {
    std::vector<T> to(std::size_t(given_.scenes));
    check(cudaMemcpyAsync(to.data(), from.data(), to.size() * sizeof(T), cudaMemcpyDeviceToHost, device_.stream()),
          "copying outcomes from the device");
    device_.wait();
    return to;
  }
  std::vector<char> decisions() const {
    const std::vector<unsigned char> found = fetched(decided_);
    return {found.begin(), found.end()};
  }

  const Device& device_;
  Index rows_;
  Kernels kernels_;
  Given given_{};
  HeldChecks checks_{};
  Memory<double> tables_, drift_;  // of all matrices, and of the checks
  Memory<HeldState> states_;
  Memory<unsigned char> decided_;
};

}  // namespace

std::unique_ptr<SceneArrays> make_scene_arrays(const Device& device, const SceneArraysProblem& problem, Index scenes) {
  if (scenes < 1) return nullptr;
  return std::make_unique<DeviceSceneArrays>(device, problem, scenes);
}

}  // namespace bromwich::cuda

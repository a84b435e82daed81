// A cycle of goal-oriented refinement, part by part and as a whole: implicit Euler (and, with dense maps of many
// states, the exponential scheme) on the ladder of RLC cells, all ways to solve the transposed chain of steps, on the
// processor and on a CUDA device where one is found.

#include "app/commands.hpp"
#include "app/text.hpp"
#include "bench/studies/study.hpp"
#include "core/base/timer.hpp"
#include "core/goal/goal.hpp"
#include "core/goal/grid_adaptation.hpp"
#include "core/goal/indicators.hpp"
#include "core/scene/port_hamiltonian.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>

namespace bromwich::app {

namespace {

struct Chain {
  double cells = 0;     ///< of the ladder, m = 3 cells + 1
  Index steps = 0;      ///< about
  bool graded = false;  ///< a grid as bisection makes it: sizes from h to h/64
  StepScheme scheme = StepScheme::euler;
  const char* grid() const { return graded ? "bisected" : "uniform"; }
};

struct Way {
  const char* name;
  AdjointChoice choice;
};

constexpr Way ways[] = {{"substitution", {AdjointMethod::substitution, 1}},
                        {"jacobi, 1 sweep", {AdjointMethod::jacobi, 1}},
                        {"jacobi, 3 sweeps", {AdjointMethod::jacobi, 3}},
                        {"doubling", {AdjointMethod::doubling, 1}},
                        {"scan", {AdjointMethod::scan, 1}}};

/// Numbers of states up to which products of maps are worth their m^3 operations: few on a CPU; hundreds on a device
/// (which converts sparse maps to dense ones up to here) in a scan, which multiplies each map once.
Index most_product_states(const Backend& backend, AdjointMethod method) {
  return backend.name() == "cpu" || method == AdjointMethod::doubling ? 64 : 384;
}

// Cells halved up to six times where a wave is high: runs of equal size that differ by powers of two.
Vector graded_grid(double T, Index about) {
  const auto halvings = [](double s) { return int(std::lround(3 + 3 * std::sin(40 * s))); };
  double weight = 0;
  for (int i = 0; i < 1000; ++i) weight += std::exp2(halvings((i + 0.5) / 1000)) / 1000;
  const Index cells = std::max<Index>(1, Index(double(about) / weight));
  std::vector<double> t{0};
  for (Index c = 0; c < cells; ++c) {
    const int parts = 1 << halvings((double(c) + 0.5) / double(cells));
    for (int p = 1; p <= parts; ++p) t.push_back(T * (double(c) + double(p) / parts) / double(cells));
  }
  return Eigen::Map<const Vector>(t.data(), Index(t.size()));
}

std::vector<double> timed_runs(Backend& backend, int repeats, const std::function<void()>& run) {
  std::vector<double> times;
  for (int round = 0; round < repeats; ++round) {
    backend.wait();
    Timer timer;
    run();
    backend.wait();
    times.push_back(timer.lap());
  }
  return times;
}

class Study {
 public:
  Study(const BenchRequest& request, BenchReport& report) : request_(request), report_(report) {
    lines_.push_back({"backend", "m", "M", "grid", "sizes", "what", "median", "min", "max", "difference"});
  }

  void measure(const Chain& c, Backend& backend) {
    const SceneChoice choice = choose_scene("ladder", {{"n", c.cells}});
    const Scene& scene = choice.scene;
    const PortSystem system(*scene.port, scene.T);
    const Vector t = c.graded ? graded_grid(scene.T, c.steps) : Vector(Vector::LinSpaced(c.steps + 1, 0, scene.T));
    const StepSizes sizes = group_steps(t);
    const StepChainProblem problem = system.step_problem(c.scheme, sizes);
    const Index m = problem.states(), M = problem.steps();
    std::unique_ptr<StepChain> chain = backend.step_chain(problem);
    const bool on_host = chain->on_host && backend.fused().step_chain;
    const auto add = [&](const char* what, const std::vector<double>& times, double apart) {
      report_.rows.push_back({{"backend", backend.name()},
                              {"scheme", to_string(c.scheme)},
                              {"elsewhere", on_host ? "steps and adjoints on the host" : ""},
                              {"states", m},
                              {"steps", M},
                              {"grid", c.grid()},
                              {"sizes", sizes.sizes.size()},
                              {"sparse", problem.sparse()},
                              {"what", what},
                              {"seconds", spread(times)},
                              {"difference_max", apart}});
      lines_.push_back({backend.name(), fmt::format("{}", m), fmt::format("{}", M), c.grid(),
                        fmt::format("{}", sizes.sizes.size()), what, format_seconds(median(times)),
                        format_seconds(minimum(times)), format_seconds(maximum(times)), scientific(apart)});
    };

    const auto plan = [&] { chain = backend.step_chain(problem); };
    add("factorizations", timed_runs(backend, request_.repeats(), plan), 0);
    RowMatrix q(M + 1, m), exact, found;
    for (Index i = 0; i <= M; ++i)
      for (Index k = 0; k < m; ++k) q(i, k) = std::cos(0.37 * double(i) + double(k * k));
    const auto forward = [&] { chain->solve(q); };
    forward();
    add("forward", timed_runs(backend, request_.repeats(), forward), 0);
    for (const Way& way : ways) {
      const bool products = way.choice.method == AdjointMethod::doubling || way.choice.method == AdjointMethod::scan;
      if (products && m > most_product_states(backend, way.choice.method)) continue;
      const auto adjoint = [&] { found = chain->solve_transposed(q, way.choice); };
      adjoint();
      if (exact.size() == 0) exact = found;
      const double apart = (found - exact).cwiseAbs().maxCoeff() / exact.cwiseAbs().maxCoeff();
      add(way.name, timed_runs(backend, request_.repeats(), adjoint), apart);
    }
    chain.reset();
    if (c.scheme != StepScheme::euler || on_host) return;
    measure_cycle(scene, t, problem, backend, add);
  }

  std::string text() const { return table(lines_); }

 private:
  using Add = std::function<void(const char* what, const std::vector<double>& times, double apart)>;

  /// From one grid to the next: arrays come from the host and return to it. A system caches its inputs, so each whole
  /// cycle, and the sources, which evaluate them first, have a new one.
  void measure_cycle(const Scene& scene, const Vector& t, const StepChainProblem& problem, Backend& backend,
                     const Add& add) {
    const int repeats = request_.repeats();
    const Vector& x0 = scene.x0;
    std::optional<PortSystem> system;
    const auto forget = [&]() -> const PortSystem& { return system.emplace(*scene.port, scene.T); };
    const auto quantity = local_balance();
    const int q = quantity->order(order(StepScheme::euler));
    RowMatrix x, gradient, l;
    {
      const auto chain = backend.step_chain(problem);
      const auto solve = [&] { x = chain->solve(step_sources(forget(), StepScheme::euler, t, x0, &backend)); };
      add("cycle: sources and forward", timed_runs(backend, repeats, solve), 0);
      const Trajectory path{*system, StepScheme::euler, t, x, 1, nullptr, &backend};
      const auto differentiate = [&] { gradient = quantity->evaluate(path, true).gradient; };
      add("cycle: quantity and its gradient", timed_runs(backend, repeats, differentiate), 0);
      const auto transposed = [&] { l = chain->solve_transposed(gradient, {}); };
      add("cycle: exact adjoint", timed_runs(backend, repeats, transposed), 0);
    }
    Vector indicators;
    const auto judge = [&] {
      indicators = goal_indicators({*system, StepScheme::euler, t, x}, backend, *quantity, CellWeights::local, l, {});
    };
    add("cycle: indicators", timed_runs(backend, repeats, judge), 0);
    Vector finer;
    const auto mark = [&] { finer = bisected(t, economical_cells(indicators, q, t.size())); };
    add("cycle: marking and bisection", timed_runs(backend, repeats, mark), 0);

    if (problem.states() > 64) return;  // they take seconds each, and the parts are known
    Vector exact;
    for (const Way& way : ways) {
      const bool products = way.choice.method == AdjointMethod::doubling || way.choice.method == AdjointMethod::scan;
      if (products && problem.states() > most_product_states(backend, way.choice.method)) continue;
      GoalOptions goal;
      goal.adjoint = way.choice;
      GoalEvaluation e;
      const auto cycle = [&] {
        e = evaluate_goal(forget(), backend, goal, t, x0);
        finer = bisected(t, economical_cells(e.indicators, q, t.size()));
      };
      const std::vector<double> times = timed_runs(backend, repeats, cycle);
      if (exact.size() == 0) exact = e.indicators;
      const double apart = (e.indicators - exact).cwiseAbs().maxCoeff() / exact.cwiseAbs().maxCoeff();
      add((std::string("whole cycle, ") + way.name).c_str(), times, apart);
    }
  }

  const BenchRequest& request_;
  BenchReport& report_;
  std::vector<std::vector<std::string>> lines_;
};

}  // namespace

BenchReport bench_adjoints(const BenchRequest& request, Backend& backend) {
  if (request.scene.value_or("ladder") != "ladder")
    throw Error("SCENE", fmt::format("found '{}'", *request.scene), "leave it out: this benchmark uses ladder");
  if (!request.settings.empty() || request.steps > 0)
    throw Error(request.steps > 0 ? "--steps" : "--set", "this benchmark has its own sizes", "leave it out");
  BenchReport report;
  report.scene = "ladder";
  report.details["seconds"] =
      "wall clock of one call on arrays of the backend, without copies from the host; factorizations: the whole plan; "
      "cycle: from one grid to the next, arrays on the host";
  report.details["difference_max"] =
      "from back substitution on the same backend, over the largest entry; whole cycle: of the indicators";
  report.details["grid"] = "uniform, or cells halved up to six times in runs, as bisection leaves it";
  Study study(request, report);
  const std::vector<Chain> chains = request.quick ? std::vector<Chain>{{5, 1000, true}, {33, 100, true}}
                                                  : std::vector<Chain>{{5, 100000, false},
                                                                       {5, 10000, true},
                                                                       {5, 100000, true},
                                                                       {21, 10000, true},
                                                                       {66, 10000, true, StepScheme::exponential},
                                                                       {100, 10000, true},
                                                                       {1000, 2000, true}};
  for (const Chain& c : chains) study.measure(c, backend);
  if (!cuda_devices().empty() && backend.name() == "cpu") {
    const auto cuda = make_cuda_backend(make_cpu_backend(backend.device().threads));
    report.parameters = {{"device", cuda->device().name}};
    for (const Chain& c : chains) study.measure(c, *cuda);
  }
  print(fmt::format("implicit Euler on the ladder, {} threads\n", backend.device().threads) + study.text());
  return report;
}

}  // namespace bromwich::app

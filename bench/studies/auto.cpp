// The choice of `auto` compared with the best possible one: every method by name on every available backend, on scenes
// of all structures and sizes. The runs are interleaved.

#include "app/backend_choice.hpp"
#include "app/commands.hpp"
#include "app/text.hpp"
#include "bench/studies/study.hpp"
#include "core/base/error.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <random>

namespace bromwich::app {

namespace {

constexpr double wanted_ratio = 1.3;  ///< of the time of the choice to the best time
constexpr double hopeless = 5;        ///< times the best so far: stopped in the warm-up
constexpr double short_solve = 0.05;  ///< seconds; below, twice as many repeats
constexpr double long_solve = 0.5;    ///< seconds; above, two

struct AutoCase {
  std::string name;
  Scene scene;
  Json parameters;
  Index steps;
};

struct Choice {
  std::string backend;  ///< "cpu", "cuda" or "auto"
  Method method;
  std::unique_ptr<Backend> machine;
  Samples samples = {};
  Result result = {};  ///< of the warm-up; arrays are dropped
  double difference = NAN;

  bool automatic() const { return method == Method::automatic; }
  bool solved() const { return result.status == Status::solved; }
  double seconds() const { return median(samples.total); }
};

// A passive network: m states that decay and are coupled by skew entries, n ports with contact.
Scene network(Index m, Index n, double T) {
  DenseDynamics d{Matrix::Zero(m, m), Matrix::Zero(m, n), Matrix::Zero(n, m)};
  for (Index i = 0; i < m; ++i) {
    d.A(i, i) = -0.5 - double(i % 7);
    for (Index j = 0; j < i; ++j) {
      d.A(i, j) = std::sin(double(1 + i * j % 101)) / std::sqrt(double(m));
      d.A(j, i) = -d.A(i, j);
    }
  }
  for (Index k = 0; k < n; ++k)
    for (Index i = k; i < m; i += n) d.B(i, k) = d.N(k, i) = 1 / std::sqrt(double(m / n + 1));
  Scene scene;
  scene.name = "network";
  scene.dynamics = d;
  scene.M = Tridiagonal{Vector::Constant(n, -0.2), Vector::Ones(n), Vector::Constant(n, -0.2)};
  scene.lcp_class = LcpClass::P;
  scene.g = [](double t, Eigen::Ref<Vector> g) {
    for (Index k = 0; k < g.size(); ++k) g[k] = std::sin(3 * t + double(k));
  };
  scene.x0 = Vector::Zero(m);
  scene.T = T;
  return scene;
}

std::vector<AutoCase> auto_cases(const BenchRequest& request) {
  std::vector<AutoCase> list;
  const auto built_in = [&](const std::string& name, const ParameterValues& settings, Index steps) {
    SceneChoice choice = choose_initial_value_scene(name, settings);
    const Json parameters = to_json(choice.parameters);
    list.push_back({name, std::move(choice.scene), parameters, steps});
    if (list.back().steps == 0) list.back().steps = list.back().scene.steps();
  };
  const auto add_network = [&](Index m, Index n, Index steps) {
    list.push_back({"network", network(m, n, 10), {{"m", m}, {"n", n}}, steps});
  };
  if (request.scene) {
    built_in(*request.scene, request.settings, request.steps);
    return list;
  }
  if (request.steps > 0 || !request.settings.empty())
    throw Error(request.steps > 0 ? "--steps" : "--set", "found without a SCENE", "name the scene they belong to");
  if (request.quick) {
    built_in("signorini", {{"Q", 15}}, 100);
    built_in("dlcp-small", {}, 64);
    return list;
  }
  for (const double Q : {15., 39., 127., 255., 511.})
    for (const Index steps : {100, 400, 4096}) built_in("signorini", {{"Q", Q}}, steps);
  built_in("signorini", {{"Q", 39}}, 65536);
  for (const Index steps : {64, 1024, 16384}) built_in("dlcp-small", {}, steps);
  for (const Index steps : {600, 9600}) built_in("bridge", {}, steps);
  for (const Index steps : {256, 4096})
    for (const auto& [m, n] : {std::pair<Index, Index>{20, 4}, {200, 10}, {200, 100}}) add_network(m, n, steps);
  return list;
}

std::vector<Choice> choices(const AutoCase& one, int threads) {
  std::vector<Choice> list;
  Options options;
  options.steps = one.steps;
  list.push_back({"auto", Method::automatic, choose_backend("auto", one.scene, options, 0, threads, true)});
  std::vector<std::string> backends{"cpu"};
  if (!cuda_devices().empty()) backends.emplace_back("cuda");
  for (const std::string& backend : backends)
    for (const Method method : {Method::march, Method::contour, Method::multigrid}) {
      options.method = method;
      list.push_back({backend, method, choose_backend(backend, one.scene, options, 0, threads)});
    }
  return list;
}

double best_of(const std::vector<Choice>& list) {
  double best = INFINITY;
  for (const Choice& c : list)
    if (c.solved() && !c.automatic()) best = std::min(best, c.seconds());
  return best;
}

// One warm-up each, then whole rounds. Refused and much too slow runs count as not solved.
void measure(std::vector<Choice>& list, const AutoCase& one, int repeats) {
  Options options;
  options.steps = one.steps;
  RowMatrix first;
  double best = INFINITY;
  for (Choice& c : list) {
    options.method = c.method;
    options.interrupted = nullptr;
    const auto start = std::chrono::steady_clock::now();
    if (std::isfinite(best) && !c.automatic())
      options.interrupted = [start, limit = hopeless * best + short_solve] {
        return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() > limit;
      };
    try {
      c.result = solve(one.scene, *c.machine, options);
    } catch (const Error& error) {
      c.result.status = Status::unsupported;
      c.result.reason = error.what();
      continue;
    }
    if (c.solved()) {
      if (first.size() == 0) first = c.result.y;
      c.difference = (c.result.y - first).cwiseAbs().maxCoeff();
      best = std::min(best, c.result.seconds.total);
    }
    for (RowMatrix* array : {&c.result.y, &c.result.x}) array->resize(0, 0);
  }
  options.interrupted = nullptr;
  const int rounds = best < short_solve ? 2 * repeats : best < long_solve ? repeats : std::min(repeats, 2);
  std::vector<Choice*> turns;
  for (Choice& c : list)
    if (c.solved()) turns.push_back(&c);
  std::mt19937 order(1);
  for (int round = 0; round < rounds; ++round) {
    std::shuffle(turns.begin(), turns.end(), order);  // previous runs affect the caches
    for (Choice* turn : turns) {
      Choice& c = *turn;
      options.method = c.method;
      const Seconds seconds = solve(one.scene, *c.machine, options).seconds;
      c.samples.add(seconds.total, seconds.setup, seconds.solve);
    }
  }
}

Json row(const AutoCase& one, const Choice& c, double best) {
  return {{"scene", one.name},
          {"parameters", one.parameters},
          {"steps", one.steps},
          {"backend_asked", c.backend},
          {"method_asked", to_string(c.method)},
          {"backend", c.result.backend},
          {"method", to_string(c.result.method)},
          {"status", to_string(c.result.status)},
          {"reason", c.result.reason},
          {"difference_from_auto", c.difference},
          {"seconds", to_json(c.samples)},
          {"ratio", c.solved() ? Json(c.seconds() / best) : Json(nullptr)}};
}

// Printed as soon as it is known: the study takes minutes.
void print_line(const std::string& scene, const std::string& steps, const std::string& chosen, const std::string& time,
                const std::string& best, const std::string& best_time, const std::string& ratio) {
  print(fmt::format("{:<22} {:>6}  {:<18} {:>8}  {:<18} {:>8}  {:>5}\n", scene, steps, chosen, time, best, best_time,
                    ratio));
}

}  // namespace

BenchReport bench_auto(const BenchRequest& request, Backend& backend) {
  BenchReport report;
  report.scene = request.scene.value_or("all of the study");
  report.details["seconds"] =
      "wall clock of whole solves, set-up included; what took more than 5 times the best in its warm-up was "
      "interrupted";
  report.details["ratio"] = "of the median to the best median of a named method that solved the scene";
  print_line("scene", "steps", "chosen", "its time", "best", "its time", "ratio");
  long within = 0, all = 0;
  for (const AutoCase& one : auto_cases(request)) {
    std::vector<Choice> list = choices(one, backend.device().threads);
    measure(list, one, request.repeats());
    const double best = best_of(list);
    const Choice *fastest = nullptr, &chosen = list.front();
    for (const Choice& c : list) {
      report.rows.push_back(row(one, c, best));
      if (c.solved() && !c.automatic() && c.seconds() == best) fastest = &c;
    }
    ++all;
    const double ratio = chosen.solved() ? chosen.seconds() / best : INFINITY;
    within += !fastest || ratio <= wanted_ratio;
    std::string parameters;
    for (const auto& [key, value] : one.parameters.items())
      if (key != "T" && key != "c" && key != "nu") parameters += fmt::format(" {}={}", key, value.dump());
    print_line(one.name + parameters, fmt::format("{}", one.steps),
               chosen.solved() ? fmt::format("{}, {}", to_string(chosen.result.method), chosen.result.backend)
                               : to_string(chosen.result.status),
               format_seconds(chosen.seconds()),
               fastest ? fmt::format("{}, {}", to_string(fastest->result.method), fastest->result.backend) : "none",
               format_seconds(best), fastest ? fmt::format("{:.2f}", ratio) : "-");
  }
  report.notes.push_back(fmt::format("{} of {} choices take at most {:g} times the best", within, all, wanted_ratio));
  print(report.notes.back() + "\n");
  return report;
}

}  // namespace bromwich::app

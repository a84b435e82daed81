// Time of a scene and step in a batch, beside a loop of single solves that one Solver has prepared. The scenes of a
// batch share their dynamics and differ in x0; y of some of them is compared with single solves. And the time of a
// derivative beside a prepared solve.

#include "batch/batch.hpp"

#include "app/commands.hpp"
#include "app/text.hpp"
#include "bench/studies/study.hpp"
#include "core/solve/solve.hpp"
#include "core/solve/solver.hpp"
#include "cpu/cpu_backend.hpp"
#include "derivatives/modal_derivative.hpp"
#include "derivatives/solution_derivative.hpp"
#include "derivatives/space_time_derivative.hpp"
#include "kernels/cuda_backend.hpp"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>
#include <memory>
#include <random>
#include <utility>

namespace bromwich::app {

namespace {

struct BatchCase {
  std::string scene;
  Index scenes, steps, single;  ///< `single`: scenes of the loop
  double part;                  ///< of x0, by which it differs
  double of_A = 0;              ///< the same of A; 0: all share it
};

std::vector<BatchCase> batch_cases(bool quick) {
  const std::string bridge = std::string(examples_folder) + "/diode-bridge.toml";
  const bool has_bridge = std::filesystem::exists(bridge);
  const Index many = quick ? 64 : 10000;
  std::vector<BatchCase> all{{"dlcp-small", quick ? 64 : 10000, quick ? Index(32) : 256, quick ? 8 : 500, 0.003},
                             {"bridge", quick ? 64 : 10000, quick ? Index(64) : 256, quick ? 8 : 500, 0.1}};
  all.push_back({"drawn", many, quick ? Index(32) : 256, quick ? 8 : 200, 0.1, 0.02});
  if (!has_bridge) return all;
  all.push_back({bridge, many, quick ? Index(200) : 1000, quick ? 4 : 100, 0.1});
  all.push_back({bridge, many, quick ? Index(200) : 1000, quick ? 4 : 100, 0.1, 0.02});
  return all;
}

Batch draw_batch(const BatchCase& c, const Scene& scene) {
  Batch batch;
  batch.common = scene;
  batch.scenes = c.scenes;
  batch.x0.resize(c.scenes, scene.states());
  std::mt19937_64 generator(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (Index k = 0; k < c.scenes; ++k)
    for (Index i = 0; i < scene.states(); ++i) batch.x0(k, i) = scene.x0[i] * (1 + c.part * uniform(generator));
  for (Index k = 0; k < c.scenes && c.of_A > 0; ++k)
    batch.A.push_back((1 + c.of_A * uniform(generator)) * to_dense(scene.dynamics).A);
  return batch;
}

// Four states and four constraints, M of class P, smooth sources.
Scene drawn_scene() {
  std::mt19937_64 generator(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto draw = [&](Index rows, Index columns) {
    return Matrix(Matrix::NullaryExpr(rows, columns, [&](Index, Index) { return uniform(generator); }));
  };
  Scene scene;
  scene.name = "drawn, n = 4";
  const Matrix P = draw(4, 4);
  scene.dynamics = DenseDynamics{draw(4, 4) - Matrix::Identity(4, 4), draw(4, 4), draw(4, 4)};
  scene.M = Matrix(P * P.transpose() + Matrix::Identity(4, 4));
  scene.x0 = draw(4, 1);
  scene.T = 6;
  scene.g = [](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < 4; ++i) g[i] = std::sin(2.3 * t + double(i) + 0.5);
  };
  return scene;
}

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void measure_batch(const BatchCase& c, Backend& backend, const BenchRequest& request, BenchReport& report,
                   std::vector<std::vector<std::string>>& lines) {
  const Scene scene = c.scene == "drawn" ? drawn_scene() : choose_scene(c.scene, {}).scene;
  const Batch batch = draw_batch(c, scene);
  Options options;
  options.method = Method::march;
  options.steps = c.steps;
  Solver solver(scene, backend, options);
  solver.solve();
  const std::string name = scene.name + (c.of_A > 0 ? ", own A" : "");
  std::vector<double> many, one, ratios;
  BatchResult found;
  double difference = 0;
  Index differ = 0;
  for (int round = 0; round < request.repeats(); ++round) {
    found = {};  // the time to free it is not counted
    auto start = std::chrono::steady_clock::now();
    found = solve_batch(batch, backend, options);
    many.push_back(1e9 * seconds_since(start) / (double(c.scenes) * double(c.steps)));
    std::vector<Result> singles;
    start = std::chrono::steady_clock::now();
    for (Index k = 0; k < c.single; ++k) {
      solver.set_x0(Vector(batch.x0.row(k).transpose()));
      singles.push_back(c.of_A > 0 ? solve(scene_of(batch, k), backend, options) : solver.solve());
    }
    one.push_back(1e9 * seconds_since(start) / (double(c.single) * double(c.steps)));
    ratios.push_back(one.back() / many.back());
    for (Index k = 0; k < c.single; ++k) {
      const Result& single = singles[std::size_t(k)];
      differ += single.status != found.status[std::size_t(k)];
      if (single.status != Status::solved) continue;
      const double size = std::max(1e-300, single.y.cwiseAbs().maxCoeff());
      difference = std::max(difference, (found.of(found.y, k) - single.y).cwiseAbs().maxCoeff() / size);
    }
  }
  lines.push_back({name, backend.name(), fmt::format("{}", c.scenes), fmt::format("{}", c.steps),
                   fmt::format("{}", found.in_lanes), fmt::format("{:.1f}", median(many)),
                   fmt::format("{:.1f}", median(one)), fmt::format("{:.1f}", median(ratios)), fmt::format("{}", differ),
                   scientific(difference)});
  report.rows.push_back({{"scene", name},
                         {"backend", backend.name()},
                         {"scenes", c.scenes},
                         {"steps", c.steps},
                         {"constraints", scene.constraints()},
                         {"states", scene.states()},
                         {"solved", found.solved()},
                         {"in_lanes", found.in_lanes},
                         {"ns_batch", spread(many)},
                         {"ns_single", spread(one)},
                         {"ratio", median(ratios)},
                         {"status_differs", differ},
                         {"difference", difference}});
}

// Derivatives of one scene, of any class that `make` makes, beside a prepared solve of it by the same method.
// Jacobian-vector products by each of `changes`, and the gradient by all data of the sum of y. `together`: calls in one
// timing.
template <class Make>
void measure_derivative(const Scene& scene, const Options& options, const std::string& kind, const Make& make,
                        const std::vector<std::pair<std::string, DataChange>>& changes, Backend& backend,
                        const BenchRequest& request, BenchReport& report, std::vector<std::vector<std::string>>& lines,
                        int together = 20) {
  Solver solver(scene, backend, options);
  Result result = solver.solve();
  auto derivative = make(result);
  SolutionChange of;
  of.y = RowMatrix::Ones(result.steps + 1, scene.constraints());
  std::vector<std::pair<std::string, std::function<void()>>> calls{
      {"a prepared solve", [&] { result = solver.solve(); }}, {"preparing a derivative", [&] { make(result); }}};
  for (const auto& change : changes)
    calls.emplace_back("jvp of " + change.first, [&] { derivative->jvp(change.second); });
  calls.emplace_back("vjp of all data", [&] { derivative->vjp(of); });
  if constexpr (requires { derivative->vjp(of, false); })
    if (!scene.dynamics->modes()) calls.emplace_back("vjp without x0", [&] { derivative->vjp(of, false); });
  std::vector<std::vector<double>> times(calls.size());
  for (int round = 0; round < request.repeats(); ++round)
    for (std::size_t i = 0; i < calls.size(); ++i) {
      const auto start = std::chrono::steady_clock::now();
      for (int k = 0; k < together; ++k) calls[i].second();
      times[i].push_back(1e6 * seconds_since(start) / together);
    }
  const double solve = median(times[0]);
  Json row{{"scene", scene.name},   {"backend", backend.name()},
           {"kind", kind},          {"method", to_string(result.method)},
           {"steps", result.steps}, {"constraints", scene.constraints()},
           {"us_solve", solve}};
  for (std::size_t i = 1; i < calls.size(); ++i) {
    const double us = median(times[i]);
    row["us"][calls[i].first] = us;
    row["over_solve"][calls[i].first] = us / solve;
    lines.push_back({scene.name, fmt::format("{}", scene.constraints()), backend.name(), kind, to_string(result.method),
                     calls[i].first, fmt::format("{:.1f}", us), fmt::format("{:.2f}", us / solve)});
  }
  report.rows.push_back(std::move(row));
}

struct SignoriniCase {
  Index n, steps;
};

std::vector<std::pair<std::string, DataChange>> changes_of(const Scene& scene, Index rows) {
  const Index n = scene.constraints();
  DataChange x0, f, g, M;
  x0.x0 = Vector::Ones(scene.states());
  f.f = RowMatrix::Ones(rows, n);
  g.g = RowMatrix::Ones(rows, n);
  M.M = Matrix::Identity(n, n);
  return {{"x0", x0}, {"f", f}, {"g", g}, {"M", M}};
}

// The same scene with A, B and N as sparse matrices alone.
void measure_sparse(const SignoriniCase& c, Backend& backend, const BenchRequest& request, BenchReport& report,
                    std::vector<std::vector<std::string>>& lines) {
  Scene scene = choose_scene("signorini", {{"Q", double(c.n)}}).scene;
  scene.dynamics = to_sparse(get<KroneckerDynamics>(scene.dynamics));
  scene.name = "signorini, sparse";
  Options options;
  options.steps = c.steps;
  options.method = Method::march;
  const auto make = [&](const Result& r) { return std::make_unique<SpaceTimeDerivative>(scene, r, backend); };
  measure_derivative(scene, options, "over all time points", make, changes_of(scene, c.steps + 1), backend, request,
                     report, lines, 1);
}

// In modes on the host, and over all time points on this backend by each method.
void measure_signorini(const SignoriniCase& c, Backend& backend, bool in_modes, const BenchRequest& request,
                       BenchReport& report, std::vector<std::vector<std::string>>& lines) {
  const Scene scene = choose_scene("signorini", {{"Q", double(c.n)}}).scene;
  const auto changes = changes_of(scene, c.steps + 1);
  Options options;
  options.steps = c.steps;
  options.method = Method::march;
  if (in_modes)
    measure_derivative(
        scene, options, "in modes on the host",
        [&](const Result& result) { return std::make_unique<ModalDerivative>(scene, result); }, changes, backend,
        request, report, lines);
  for (const Method method : {Method::march, Method::contour, Method::multigrid}) {
    options.method = method;
    measure_derivative(
        scene, options, "over all time points",
        [&](const Result& result) { return std::make_unique<SpaceTimeDerivative>(scene, result, backend); }, changes,
        backend, request, report, lines);
  }
}

void measure_derivatives(Backend& backend, const BenchRequest& request, BenchReport& report,
                         std::vector<std::vector<std::string>>& lines) {
  DataChange by_x0, by_A;
  by_x0.x0 = Vector::Ones(4);
  by_A.A = Matrix::Ones(4, 4);
  Options options;
  options.method = Method::march;
  options.steps = request.quick ? 64 : 1000;
  options.states = StateSelection::all;
  const Scene drawn = drawn_scene();
  measure_derivative(
      drawn, options, "dense",
      [&](const Result& result) { return std::make_unique<SolutionDerivative>(drawn, result); },
      {{"x0", by_x0}, {"A", by_A}}, backend, request, report, lines);
  for (const Index n : request.quick ? std::vector<Index>{15} : std::vector<Index>{39, 127})
    measure_signorini({n, request.quick ? 64 : 400}, backend, true, request, report, lines);
  measure_sparse({request.quick ? 15 : 63, request.quick ? 64 : 400}, backend, request, report, lines);
}

// Of one device, with a host that has the same threads.
void measure_on_device(Backend& device, const BenchRequest& request, BenchReport& report,
                       std::vector<std::vector<std::string>>& lines) {
  for (const Index n : request.quick ? std::vector<Index>{15} : std::vector<Index>{127, 511})
    measure_signorini({n, request.quick ? 64 : 400}, device, true, request, report, lines);
}

}  // namespace

BenchReport bench_batch(const BenchRequest& request, Backend& backend) {
  refuse_scene(request);
  BenchReport report;
  report.scene = "several";
  report.details["ns_batch"] = "solve_batch: wall clock over scenes and steps, in nanoseconds, checks included";
  report.details["ns_single"] =
      "Solver::set_x0 and Solver::solve in a loop, or solve where scenes have their own A: likewise";
  report.details["in_lanes"] = "scenes that were stepped side by side";
  report.details["us"] =
      "of derivatives/, in microseconds; us_solve: a prepared solve of the same scene by the method of the row";
  report.details["difference"] = "largest |y - y of the single solve| / max |y|";
  std::vector<std::vector<std::string>> lines{
      {"scene", "backend", "scenes", "J", "side by side", "ns", "ns single", "ratio", "other status", "difference"}};
  for (const BatchCase& c : batch_cases(request.quick)) measure_batch(c, backend, request, report, lines);
  if (!cuda_devices().empty()) {
    const auto device = make_cuda_backend(make_cpu_backend(backend.device().threads));
    for (const BatchCase& c : batch_cases(request.quick))
      if (c.of_A == 0) measure_batch(c, *device, request, report, lines);  // other matrices are stepped on the host
  }
  print(fmt::format("nanoseconds a scene and step in batches, and in a loop of prepared solves; {} threads\n{}",
                    backend.device().threads, table(lines)));
  std::vector<std::vector<std::string>> derivatives{
      {"scene", "n", "backend", "kind", "method", "derivative", "us", "over a prepared solve"}};
  measure_derivatives(backend, request, report, derivatives);
  if (!cuda_devices().empty())
    measure_on_device(*make_cuda_backend(make_cpu_backend(backend.device().threads)), request, report, derivatives);
  print(fmt::format("microseconds\n{}", table(derivatives)));
  return report;
}

}  // namespace bromwich::app

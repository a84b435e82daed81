// Time saved by a Solver: whole solves of a scene alternate with solves with another x0, and with another x0
// and f, by a Solver. Each y of the
// Solver is compared with that of the whole solve of the same scene.

#include "core/solve/solver.hpp"

#include "app/commands.hpp"
#include "app/text.hpp"
#include "bench/studies/study.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"

#include <fmt/format.h>

#include <chrono>

namespace bromwich::app {

namespace {

struct PreparedCase {
  const char* scene;
  ParameterValues parameters;
  Index steps;
  Method method;
};

std::vector<PreparedCase> prepared_cases(bool quick) {
  if (quick) return {{"signorini", {{"Q", 39}}, 100, Method::automatic}};
  std::vector<PreparedCase> all;
  for (const double Q : {127., 511.})
    for (const Index J : {Index(400), Index(4096)})
      for (const Method method : {Method::march, Method::multigrid})
        all.push_back({"signorini", {{"Q", Q}}, J, method});
  all.push_back({"ladder-diodes", {}, 1000, Method::march});
  all.push_back({"dlcp-small", {}, 1024, Method::march});
  return all;
}

struct WallTimes {
  std::vector<double> wall;
  Samples parts;
};

template <class Solve>
Result timed_solve(WallTimes& times, const Solve& solve) {
  const auto start = std::chrono::steady_clock::now();
  Result result = solve();
  times.wall.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  times.parts.add(result.seconds.total, result.seconds.setup, result.seconds.solve);
  return result;
}

// Wall clock over the solve without its set-up: the median of the ratios of single runs.
double over_solve(const WallTimes& t) {
  std::vector<double> ratios;
  for (std::size_t i = 0; i < t.wall.size(); ++i) ratios.push_back(t.wall[i] / std::max(1e-300, t.parts.solve[i]));
  return median(ratios);
}

Json wall_seconds(const WallTimes& t) {
  Json json = spread(t.wall);
  json["setup"] = median(t.parts.setup);
  json["solve"] = median(t.parts.solve);
  json["over_solve"] = over_solve(t);
  return json;
}

// Of the same kind, so that sampling it costs the same.
TimeFunction scaled(double factor, const TimeFunction& function) {
  if (!function) return {};
  if (const SeparableSource* s = function.separable()) return SeparableSource{factor * s->shapes, s->time};
  return [factor, function](double t, Eigen::Ref<Vector> value) {
    function(t, value);
    value *= factor;
  };
}

double apart(const Result& found, const Result& expected) {
  return (found.y - expected.y).cwiseAbs().maxCoeff() / std::max(1e-300, expected.y.cwiseAbs().maxCoeff());
}

void measure_prepared(const PreparedCase& c, Backend& backend, const BenchRequest& request, BenchReport& report,
                      std::vector<std::vector<std::string>>& lines) {
  const SceneChoice choice = choose_scene(c.scene, c.parameters);
  Options options;
  options.method = c.method;
  options.steps = c.steps;
  options.tuning.algebraic_share = c.method == Method::multigrid ? 0.1 : 0;
  Solver solver(choice.scene, backend, options);
  solver.solve();
  WallTimes whole, again, with_f;
  Scene changed = choice.scene;
  double difference = 0;
  Result result;
  for (int round = 0; round < request.repeats(); ++round) {
    changed.x0 *= 0.999;
    const Result expected = timed_solve(whole, [&] { return solve(changed, backend, options); });
    result = timed_solve(again, [&] {
      solver.set_x0(changed.x0);
      return solver.solve();
    });
    difference = std::max(difference, apart(result, expected));
    changed.x0 *= 0.999;
    changed.f = scaled(0.999, changed.f);
    const Result other = timed_solve(with_f, [&] {
      solver.set_x0(changed.x0);
      solver.set_sources(changed.f, changed.g, changed.breakpoints, changed.breakpoints_are_all);
      return solver.solve();
    });
    difference = std::max(difference, apart(other, solve(changed, backend, options)));
  }
  const std::string name =
      c.parameters.empty() ? c.scene : fmt::format("{} Q={:g}", c.scene, c.parameters.begin()->second);
  lines.push_back({name, backend.name(), fmt::format("{}", c.steps), to_string(result.method),
                   format_seconds(median(whole.wall)), format_seconds(median(again.wall)),
                   format_seconds(median(again.parts.setup)), fmt::format("{:.3f}", over_solve(again)),
                   format_seconds(median(with_f.wall)), fmt::format("{:.3f}", over_solve(with_f)),
                   format_seconds(median(whole.parts.solve)), scientific(difference)});
  report.rows.push_back({{"scene", c.scene},
                         {"backend", backend.name()},
                         {"parameters", to_json(choice.parameters)},
                         {"steps", c.steps},
                         {"method", to_string(result.method)},
                         {"status", to_string(result.status)},
                         {"whole", wall_seconds(whole)},
                         {"again", wall_seconds(again)},
                         {"again_with_f", wall_seconds(with_f)},
                         {"difference", difference}});
}

}  // namespace

BenchReport bench_solver(const BenchRequest& request, Backend& backend) {
  refuse_scene(request);
  BenchReport report;
  report.scene = "several";
  report.details["whole"] = "solve(scene with a new x0): wall clock, and the medians of set-up and solve";
  report.details["again"] = "Solver::set_x0 and Solver::solve of the same: wall clock of both";
  report.details["again_with_f"] = "Solver::set_x0, set_sources and solve with another x0 and f: likewise";
  report.details["over_solve"] =
      "wall clock of the line over the solve without its set-up of the same runs: median of the ratios";
  report.details["difference"] = "largest |y - y of the whole solve| / max |y|";
  std::vector<std::vector<std::string>> lines{{"scene", "backend", "J", "method", "whole", "again", "its set-up",
                                               "over solve", "with f", "over solve", "solve in whole", "difference"}};
  std::unique_ptr<Backend> device;
  if (!cuda_devices().empty()) device = make_cuda_backend(make_cpu_backend(backend.device().threads));
  for (Backend* on : {&backend, device.get()})
    for (const PreparedCase& c : prepared_cases(request.quick))
      if (on) measure_prepared(c, *on, request, report, lines);
  print(fmt::format("a scene solved from the beginning, and again with another x0; {} threads\n{}",
                    backend.device().threads, table(lines)));
  return report;
}

}  // namespace bromwich::app

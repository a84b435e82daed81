// The functional iteration compared with time stepping on the same scene, with the error that each one reaches. The
// runs are interleaved, so that a slow phase of the machine affects all contestants equally.

#include "app/commands.hpp"
#include "app/text.hpp"
#include "bench/studies/study.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

namespace bromwich::app {

namespace {

/// Errors this close are errors of the same discretisation: the solvers then differ in time only.
constexpr double same_error = 1.01;
/// Times closer than this do not show which one is faster.
constexpr double noise = 1.05;
constexpr Index max_reference_steps = 65536;

struct Contestant {
  std::string name;
  Options options;
  bool iterates = false;  ///< solves all time points at once
  Samples samples = {};
  Result result = {};  ///< of the warm-up, arrays dropped
  Deviation error = {};
  double from_contour = NAN;  ///< max |y - y of the converged iteration|, all times, same discretisation only

  bool solved() const { return result.status == Status::solved; }
  /// The least: what other processes do to the machine is added to times.
  double seconds() const { return minimum(samples.total); }
};

Contestant contestant(const std::string& name, Method method, Index steps) {
  Contestant made{name, {}, method == Method::contour};
  made.options.method = method;
  made.options.steps = steps;
  return made;
}

std::vector<Contestant> contestants(const Scene& scene, Index steps) {
  const auto* kronecker = get_if<KroneckerDynamics>(&scene.dynamics);
  std::vector<Contestant> list{contestant("contour", Method::contour, steps)};
  if (kronecker && scene.name == "signorini") {
    // Stopping rule (4.8) of the paper on Laplace inversion for contact problems.
    const double h = scene.T / double(steps), dx = kronecker->along.spacing;
    list.push_back(contestant("contour (paper's tolerance)", Method::contour, steps));
    list.back().options.iteration_tolerance = std::min(h, dx * dx) / 50;
  }
  if (kronecker) {
    list.push_back(contestant("march (modal)", Method::march, steps));
    list.back().options.tuning.recurrence = RecurrenceChoice::modal;
    list.push_back(contestant("march (compressed)", Method::march, steps));
    list.back().options.tuning.recurrence = RecurrenceChoice::compressed;
  } else {
    list.push_back(contestant("march", Method::march, steps));
  }
  list.push_back(contestant("euler", Method::euler, steps));
  return list;
}

/// Implicit Euler with the fewest steps (by doubling) that reach `error`: the fair comparison. Empty if memory or the
/// largest reference is exhausted before.
std::optional<Contestant> euler_at_equal_error(const Scene& scene, Backend& backend, Index steps, double error,
                                               const Truth& truth) {
  for (Index factor = 2; steps * factor <= 16 * max_reference_steps; factor *= 2) {
    try {
      check_memory(scene, steps * factor, 0);
    } catch (const Error&) {
      return std::nullopt;
    }
    Contestant c = contestant(fmt::format("euler ({} x steps)", factor), Method::euler, steps * factor);
    c.result = solve(scene, backend, c.options);
    if (!c.solved()) return std::nullopt;
    c.error = truth.of(c.result).y;
    if (c.error.max <= error) return c;
    // First order: a doubling at most halves the error, so the distance to `error` allows several at once.
    while (c.error.max > 2.5 * error && steps * factor * 2 <= 16 * max_reference_steps) factor *= 2, c.error.max /= 2;
  }
  return std::nullopt;
}

Index reference_steps(Index steps, bool quick) {
  Index factor = quick ? 8 : 64;
  while (factor > 4 && steps * factor > max_reference_steps) factor /= 2;
  return steps * factor;
}

/// One warm-up each, which also gives the error; then whole rounds, so that no contestant runs twice in a row.
void measure(std::vector<Contestant>& list, const Scene& scene, Backend& backend, Index steps, const Truth& truth,
             int repeats) {
  RowMatrix converged;
  for (Contestant& c : list) {
    c.result = solve(scene, backend, c.options);
    c.error = truth.of(c.result).y;
    const RowMatrix y = common_rows(c.result.y, c.options.steps / steps);
    if (converged.size() == 0) converged = y;
    if (c.options.method != Method::euler) c.from_contour = (y - converged).cwiseAbs().maxCoeff();
    for (RowMatrix* array : {&c.result.y, &c.result.x}) array->resize(0, 0);
  }
  for (int round = 0; round < repeats; ++round)
    for (Contestant& c : list) {
      if (!c.solved()) continue;
      const Seconds seconds = solve(scene, backend, c.options).seconds;
      c.samples.add(seconds.total, seconds.setup, seconds.solve);
    }
}

std::string measured_table(const std::vector<Contestant>& list) {
  std::vector<std::vector<std::string>> rows{{"contestant", "steps", "iterations", "error max", "error rms", "residual",
                                              "median", "min", "max", "setup", "solve", "memory", "status"}};
  for (const Contestant& c : list)
    rows.push_back({c.name, fmt::format("{}", c.options.steps), fmt::format("{}", c.result.iterations),
                    scientific(c.error.max), scientific(c.error.rms), scientific(c.result.residual),
                    format_seconds(median(c.samples.total)), format_seconds(minimum(c.samples.total)),
                    format_seconds(maximum(c.samples.total)), format_seconds(median(c.samples.setup)),
                    format_seconds(median(c.samples.solve)), format_bytes(double(c.result.bytes)),
                    to_string(c.result.status)});
  return table(rows);
}

Json row(const Contestant& c, const SceneChoice& choice) {
  return {{"contestant", c.name},
          {"parameters", to_json(choice.parameters)},
          {"method", to_string(c.result.method)},
          {"kernel", c.result.kernel},
          {"iteration_tolerance", c.iterates ? Json(c.options.iteration_tolerance) : Json(nullptr)},
          {"status", to_string(c.result.status)},
          {"steps", c.options.steps},
          {"iterations", c.result.iterations},
          {"error_max", c.error.max},
          {"error_rms", c.error.rms},
          {"difference_from_contour", c.from_contour},
          {"residual", c.result.residual},
          {"seconds", to_json(c.samples)},
          {"bytes", c.result.bytes}};
}

const Contestant* fastest(const std::vector<const Contestant*>& list) {
  const auto best = std::min_element(list.begin(), list.end(),
                                     [](const auto* a, const auto* b) { return a->seconds() < b->seconds(); });
  return best == list.end() ? nullptr : *best;
}

/// The fastest contestant among those with the smallest error on the given grid.
std::string winner(const std::vector<Contestant>& list) {
  const auto entered = [&](const Contestant& c) { return c.solved() && c.options.steps == list.front().options.steps; };
  double smallest = INFINITY;
  for (const Contestant& c : list)
    if (entered(c) && c.error.max < smallest) smallest = c.error.max;
  std::vector<const Contestant*> equal;
  for (const Contestant& c : list)
    if (entered(c) && c.error.max <= same_error * smallest) equal.push_back(&c);
  const Contestant* best = fastest(equal);
  if (!best) return "no contestant solved this case";
  return fmt::format("fastest at the smallest error ({:.2e}): {}, {}", best->error.max, best->name,
                     format_seconds(best->seconds()));
}

/// One variant of the iteration compared with one marching; a shorter time with a larger error is reported as such.
std::string comparison(const Contestant& c, const Contestant& march) {
  const double ratio = c.seconds() / march.seconds(), error = c.error.max / march.error.max;
  const std::string at = error > same_error ? fmt::format(", at {:.3g} x its error", error) : "";
  if (ratio > noise) return fmt::format("{0} loses: {1} is {2:.3g} x faster than {0} here", c.name, march.name, ratio);
  if (ratio < 1 / noise)
    return fmt::format("{} wins: it is {:.3g} x faster than {} here{}", c.name, 1 / ratio, march.name, at);
  return fmt::format("{} and {} take the same time here{}", c.name, march.name, at);
}

/// Implicit Euler at the error of the others, if it reached it.
std::string euler_note(const std::vector<Contestant>& list) {
  const Contestant& last = list.back();
  const Contestant* best = nullptr;
  for (const Contestant& c : list)
    if (c.solved() && c.options.method != Method::euler && (!best || c.seconds() < best->seconds())) best = &c;
  if (!best || last.options.steps == list.front().options.steps || !last.solved())
    return "implicit Euler does not reach the error of the others within the steps tried";
  return fmt::format("at equal error implicit Euler needs {} steps and {:.3g} x the time of {}", last.options.steps,
                     last.seconds() / best->seconds(), best->name);
}

/// Every variant of the iteration compared with the fastest marching, including the cases where it loses.
std::vector<std::string> conclusions(const std::vector<Contestant>& list) {
  std::vector<std::string> notes{winner(list), euler_note(list)};
  std::vector<const Contestant*> marching;
  for (const Contestant& c : list)
    if (c.solved() && c.options.method == Method::march) marching.push_back(&c);
  const Contestant* march = fastest(marching);
  for (const Contestant& c : list) {
    if (!c.iterates) continue;
    if (!c.solved() || !march) {
      notes.push_back(fmt::format("{} is not compared: {}", c.name,
                                  c.solved() ? "no march solved this case" : to_string(c.result.status)));
      continue;
    }
    notes.push_back(comparison(c, *march));
  }
  return notes;
}

struct Case {
  ParameterValues settings;
  Index steps;
};

std::vector<Case> cases(const BenchRequest& request, const std::string& scene) {
  if (scene != "signorini" || request.steps > 0 || !request.settings.empty())
    return {{request.settings, request.steps}};
  std::vector<Case> list{{{{"Q", 39}}, 400}};
  if (!request.quick)
    for (const auto& [Q, steps] : {std::pair(127.0, 400), {511.0, 400}, {511.0, 4096}})
      list.push_back({{{"Q", Q}}, steps});
  return list;
}

void run_case(const Case& one, const BenchRequest& request, Backend& backend, BenchReport& report) {
  const SceneChoice choice = choose_initial_value_scene(report.scene, one.settings);
  const Scene& scene = choice.scene;
  const Index steps = one.steps > 0 ? one.steps : scene.steps();
  check_memory(scene, steps, 0);
  const Truth truth(scene, backend, reference_steps(steps, request.quick));
  auto list = contestants(scene, steps);
  const double error = truth.of(solve(scene, backend, list[0].options)).y.max;
  if (const auto fair = euler_at_equal_error(scene, backend, steps, error, truth)) list.push_back(*fair);
  measure(list, scene, backend, steps, truth, request.repeats());

  // Comparisons are those of the least times, so that they hold on a busy machine.
  const std::string title = fmt::format("{} ({}), {} steps, {} repeats (least compared), {} threads; error: {}, {}",
                                        scene.name, describe(choice.parameters), steps, request.repeats(),
                                        backend.device().threads, error_definition, truth.source());
  std::string text = title + "\n" + measured_table(list);
  for (const std::string& note : conclusions(list)) {
    text += note + "\n";
    report.notes.push_back(fmt::format("{} ({}), {} steps: {}", scene.name, describe(choice.parameters), steps, note));
  }
  print(text + "\n");

  // Parameters that differ between the cases do not describe the whole benchmark.
  Json parameters = to_json(choice.parameters);
  if (report.rows.empty()) report.parameters = parameters;
  for (const auto& [key, value] : parameters.items())
    if (report.parameters.contains(key) && report.parameters[key] != value) report.parameters.erase(key);
  for (const Contestant& c : list) {
    report.rows.push_back(row(c, choice));
    report.rows.back()["reference"] = truth.source();
  }
}

}  // namespace

BenchReport bench_baselines(const BenchRequest& request, Backend& backend) {
  BenchReport report;
  report.scene = request.scene.value_or("signorini");
  report.details["error"] = error_definition;
  report.details["seconds"] = "wall clock; median, min and max of the whole solve, medians of its two parts";
  for (const Case& one : cases(request, report.scene)) run_case(one, request, backend, report);
  return report;
}

}  // namespace bromwich::app

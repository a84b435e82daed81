// Speed against error: every method over a sequence of steps (or of nodes P), called a ladder, on one thread and on
// all; suitable methods also on a CUDA device if there is one. Each run has its time and the errors of y and of the
// trace N x. A method ends its ladder when it is too slow, or as accurate as the reference.

#include "app/commands.hpp"
#include "app/text.hpp"
#include "bench/studies/study.hpp"
#include "core/base/error.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>

namespace bromwich::app {

namespace {

/// Limits of a ladder: with these a full study of one scene takes a few minutes.
struct Limits {
  double seconds;         ///< of one solve; a method that took longer ends its ladder
  Index first_steps;      ///< of every ladder
  Index reference_steps;  ///< at most
  Index literal_steps;    ///< the grid on which the nodes of contour-literal are varied
};

/// An error this close to the accuracy of the reference is not resolved.
constexpr double resolved = 4;
/// Smaller errors of y are near rounding and not refined further.
constexpr double exact_enough = 1e-9;

struct Runner {
  Backend* backend;
  int threads;  ///< of the host

  bool device() const { return !backend->traits().one_at_a_time; }
  std::string words() const {
    return device() ? "the device" : fmt::format("{} thread{}", threads, threads == 1 ? "" : "s");
  }
};

struct LadderContestant {
  std::string name;
  Options options;
  Runner runner;
  Samples samples = {};
  Result result = {};  ///< of the warm-up, arrays dropped
  Errors errors = {};

  bool literal() const { return options.method == Method::contour_literal; }
  bool solved() const { return result.status == Status::solved; }
  double seconds() const { return median(samples.total); }
};

struct Ladder {
  std::string name;
  Options options;
  bool nodes = false;     ///< its ladder increases P on one grid, not the steps
  bool iterates = false;  ///< with a device: run there and on all threads, not on one
  bool on_device = false;
};

/// Multigrid ends when its estimated algebraic error is this part of its estimated discretisation error.
constexpr double useful_share = 0.03;  ///< small, since the error before T/16, which is not compared, is larger

std::vector<Ladder> ladders(const Scene& scene, const Limits& limits, bool device) {
  const auto ladder = [&](const std::string& name, Method method) {
    Ladder made{name, {}};
    made.options.method = method;
    made.options.steps = limits.first_steps;
    made.options.trace = true;
    return made;
  };
  std::vector<Ladder> list{ladder("contour", Method::contour)};
  list.back().iterates = list.back().on_device = true;
  if (holds<KroneckerDynamics>(scene.dynamics)) {
    list.push_back(ladder("multigrid", Method::multigrid));
    list.back().options.tuning.algebraic_share = useful_share;
    list.back().iterates = list.back().on_device = true;
    list.push_back(ladder("march (modal)", Method::march));
    list.back().options.tuning.recurrence = RecurrenceChoice::modal;
    list.push_back(ladder("march (compressed)", Method::march));
    list.back().options.tuning.recurrence = RecurrenceChoice::compressed;
    list.back().on_device = true;
  } else {
    list.push_back(ladder("march", Method::march));
  }
  list.push_back(ladder("euler", Method::euler));
  if (device) return list;  // the literal method is measured without a device
  list.push_back(ladder("contour-literal", Method::contour_literal));
  list.push_back(ladder("contour-literal, nodes", Method::contour_literal));
  list.back().options.steps = limits.literal_steps;
  list.back().options.tuning.literal_nodes = 4;
  list.back().nodes = true;
  return list;
}

/// Ends a ladder below the error of the reference.
bool worth_refining(const Errors& errors, const Truth& truth) {
  return !(errors.y.max < std::max(resolved * truth.known_to().y.max, exact_enough));
}

/// One run of a ladder: solved once, for the warm-up and the error.
LadderContestant rung(const Ladder& ladder, const Options& options, const Scene& scene, const Runner& runner,
                      const Truth& truth) {
  LadderContestant c{ladder.name, options, runner};
  check_memory(scene, options.steps, 0);
  c.result = solve(scene, *runner.backend, options);
  c.errors = truth.of(c.result);
  for (RowMatrix* array : {&c.result.y, &c.result.x, &c.result.trace}) array->resize(0, 0);
  c.options.trace = false;
  return c;
}

/// All runs of one ladder on one runner.
void climb(const Ladder& ladder, const Scene& scene, const Runner& runner, const Truth& truth, const Limits& limits,
           std::vector<LadderContestant>& list) {
  Options options = ladder.options;
  double before = 0;
  for (;;) {
    const Index most = truth.steps() > 0 ? truth.steps() : Index(1) << 22;
    if (options.steps > most || options.tuning.literal_nodes > 100) return;
    LadderContestant c = rung(ladder, options, scene, runner, truth);
    const double seconds = c.result.seconds.total;
    const bool hopeless = c.result.status == Status::unsupported;
    // If more nodes do not change the error, the steps limit it.
    const bool saturated = ladder.nodes && before > 0 && c.errors.y.max > 0.99 * before;
    before = c.errors.y.max;
    const bool finest = c.solved() && !worth_refining(c.errors, truth);
    list.push_back(std::move(c));
    if (hopeless || saturated || finest || seconds > limits.seconds) return;
    if (ladder.nodes)
      options.tuning.literal_nodes = options.tuning.literal_nodes * 3 / 2;
    else
      options.steps *= 2;
  }
}

/// Whole rounds, so that no contestant runs twice in a row and a slow phase of the machine affects all equally.
void measure(std::vector<LadderContestant>& list, const Scene& scene, int repeats) {
  for (int round = 0; round < repeats; ++round)
    for (LadderContestant& c : list) {
      if (!c.solved()) continue;
      const Seconds seconds = solve(scene, *c.runner.backend, c.options).seconds;
      c.samples.add(seconds.total, seconds.setup, seconds.solve);
    }
}

Json row(const LadderContestant& c, const std::string& scene, const SceneChoice& choice, const Truth& truth) {
  return {{"scene", scene},
          {"parameters", to_json(choice.parameters)},
          {"contestant", c.name},
          {"method", to_string(c.result.method)},
          {"kernel", c.result.kernel},
          {"backend", c.result.backend},
          {"threads", c.runner.threads},
          {"steps", c.options.steps},
          {"literal_nodes", c.literal() ? Json(c.options.tuning.literal_nodes) : Json(nullptr)},
          {"iteration_tolerance", c.options.iteration_tolerance},
          {"algebraic_share", c.options.tuning.algebraic_share},
          {"status", to_string(c.result.status)},
          {"reason", c.result.reason},
          {"iterations", c.result.iterations},
          {"error", to_json(c.errors)},
          {"residual", c.result.residual},
          {"seconds", to_json(c.samples)},
          {"bytes", c.result.bytes},
          {"reference", truth.source()},
          {"reference_known_to", to_json(truth.known_to())}};
}

std::string measured_table(const std::vector<LadderContestant>& list) {
  std::vector<std::vector<std::string>> rows{{"contestant", "on", "steps", "nodes", "iterations", "error y", "rms y",
                                              "error N x", "median", "min", "max", "status"}};
  for (const LadderContestant& c : list)
    rows.push_back({c.name, c.runner.words(), fmt::format("{}", c.options.steps),
                    c.literal() ? fmt::format("{}", c.options.tuning.literal_nodes + 1) : "-",
                    fmt::format("{}", c.result.iterations), scientific(c.errors.y.max), scientific(c.errors.y.rms),
                    scientific(c.errors.trace.max), format_seconds(c.seconds()),
                    format_seconds(minimum(c.samples.total)), format_seconds(maximum(c.samples.total)),
                    to_string(c.result.status)});
  return table(rows);
}

/// The fastest run of a contestant, on any number of threads, with an error of y of at most `error`.
const LadderContestant* fastest(const std::vector<LadderContestant>& list, double error, const auto& belongs) {
  const LadderContestant* best = nullptr;
  for (const LadderContestant& c : list)
    if (c.solved() && c.errors.y.max <= error && belongs(c) && (!best || c.seconds() < best->seconds())) best = &c;
  return best;
}

std::string words(const LadderContestant& c) {
  return fmt::format("{} with {} steps on {}: {}", c.name, c.options.steps, c.runner.words(),
                     format_seconds(c.seconds()));
}

/// The fastest contestant at an error, and by which factor; implicit Euler and the iteration are always included.
std::string at_error(const std::vector<LadderContestant>& list, double error) {
  const LadderContestant* best = fastest(list, error, [](const LadderContestant&) { return true; });
  if (!best) return "";
  std::string text = fmt::format("error of y {:.0e}: fastest is {}", error, words(*best));
  for (const Method method : {Method::euler, Method::contour}) {
    if (best->options.method == method) continue;
    const LadderContestant* other =
        fastest(list, error, [&](const LadderContestant& c) { return c.options.method == method; });
    if (other)
      text += fmt::format("; {:.3g} x of that: {}", other->seconds() / best->seconds(), words(*other));
    else
      text += fmt::format("; {} does not get there on this ladder", to_string(method));
  }
  return text;
}

/// Runs in which a method gave no solution.
std::vector<std::string> failures(const std::vector<LadderContestant>& list) {
  std::vector<std::string> notes;
  std::map<std::string, std::string> steps_of;
  for (const LadderContestant& c : list)
    if (!c.solved())
      steps_of[c.name] += fmt::format("{}{}", steps_of[c.name].empty() ? "" : ", ", c.options.steps) +
                          fmt::format(" ({})", to_string(c.result.status));
  for (const auto& [name, steps] : steps_of)
    notes.push_back(fmt::format("{} is not solved with steps: {}", name, steps));
  return notes;
}

void run_scene(const std::string& name, const ParameterValues& settings, const Limits& limits,
               const BenchRequest& request, Backend& backend, BenchReport& report) {
  const SceneChoice choice = choose_initial_value_scene(name, settings);
  const Scene& scene = choice.scene;
  const Truth truth(scene, backend, limits.reference_steps);
  const auto alone = make_cpu_backend(1);
  std::vector<Runner> runners{{alone.get(), 1}};
  if (backend.device().threads > 1) runners.push_back({&backend, backend.device().threads});
  std::unique_ptr<Backend> cuda;
  if (!cuda_devices().empty() && backend.name() == "cpu") {
    cuda = make_cuda_backend(make_cpu_backend(backend.device().threads));
    runners.push_back({cuda.get(), backend.device().threads});
    report.parameters["device"] = cuda->device().name;
  }

  std::vector<LadderContestant> list;
  for (const Ladder& ladder : ladders(scene, limits, cuda != nullptr))
    for (const Runner& runner : runners) {
      const bool alone_too = !cuda || !ladder.iterates || runner.threads > 1;
      if (runner.device() ? ladder.on_device : alone_too) climb(ladder, scene, runner, truth, limits, list);
    }
  measure(list, scene, request.repeats());

  const std::string title = choice.parameters.empty() || scene.name != name
                                ? scene.name
                                : fmt::format("{} ({})", scene.name, describe(choice.parameters));
  std::string text = fmt::format("{}: error against {} (known to {}), {} repeats\n", title, truth.source(),
                                 scientific(truth.known_to().y.max), request.repeats());
  text += measured_table(list);
  std::vector<std::string> notes;
  for (const double error : {1e-2, 1e-3, 1e-4, 1e-5, 1e-6})
    if (const std::string note = at_error(list, error); !note.empty()) notes.push_back(note);
  for (const std::string& note : failures(list)) notes.push_back(note);
  for (const std::string& note : notes) {
    text += note + "\n";
    report.notes.push_back(title + ": " + note);
  }
  print(text + "\n");
  for (const LadderContestant& c : list) report.rows.push_back(row(c, scene.name, choice, truth));
}

struct LadderCase {
  std::string scene;
  ParameterValues settings;
  Limits limits;
};

constexpr const char* circuits[] = {"examples/rlcd.toml", "examples/diode-bridge.toml"};

std::vector<LadderCase> cases(const BenchRequest& request) {
  const Limits small{1.5, 32, Index(1) << 18, 512}, of_large{4, 32, Index(1) << 16, 64}, quick{0.02, 32, 4096, 64};
  constexpr Index large = 256;  // constraints
  if (request.scene) {
    Limits limits = request.quick ? quick : small;
    if (!request.quick && choose_scene(*request.scene, request.settings).scene.constraints() > large) limits = of_large;
    if (request.steps > 0) limits.reference_steps = request.steps;
    return {{*request.scene, request.settings, limits}};
  }
  if (!request.settings.empty() || request.steps > 0)
    throw Error(request.steps > 0 ? "--steps" : "--set", "found without a SCENE", "name the scene they belong to");
  if (request.quick) return {{"signorini", {{"Q", 15}}, quick}, {"dlcp-small", {}, quick}};
  std::vector<LadderCase> list{{"signorini", {{"Q", 39}}, small},
                               {"signorini", {{"Q", 511}}, of_large},
                               {"dlcp-small", {}, small},
                               {"bridge", {}, small}};
  for (const char* circuit : circuits)
    if (std::filesystem::exists(circuit)) list.push_back({circuit, {}, small});
  return list;
}

}  // namespace

BenchReport bench_speed_vs_error(const BenchRequest& request, Backend& backend) {
  BenchReport report;
  report.scene = request.scene.value_or("signorini, dlcp-small, bridge, circuits");
  report.details["error"] = error_definition;
  report.details["error.trace"] = "the same of N x, which needs no separate scale where N picks states";
  report.details["seconds"] =
      "wall clock of whole solves without output, all contestants of a scene interleaved; median, min and max; medians "
      "of the two parts";
  report.details["multigrid"] = fmt::format(
      "ends where what its iteration leaves is below {} of the discretisation error, both as it estimates them",
      useful_share);
  report.details["ladder"] =
      "steps doubled, or nodes P grown by a half on one grid, until a solve takes too long or the error is below what "
      "the reference is known to; P + 1 shifted solves a time point";
  report.details["reference_known_to"] =
      "deviation of the reference from itself with half its steps; 0: exact solution";
  for (const LadderCase& one : cases(request)) run_scene(one.scene, one.settings, one.limits, request, backend, report);
  for (const char* circuit : circuits) {
    if (request.scene || request.quick || std::filesystem::exists(circuit)) continue;
    report.notes.push_back(fmt::format("left out: {}, which was not found from the current folder", circuit));
    print(report.notes.back() + "\n");
  }
  return report;
}

}  // namespace bromwich::app

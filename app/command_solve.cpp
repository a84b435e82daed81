// `bromwich solve`: all input is checked before the first step is computed.

#include "app/arguments.hpp"
#include "app/backend_choice.hpp"
#include "app/commands.hpp"
#include "app/goal_arguments.hpp"
#include "app/interaction.hpp"
#include "app/log.hpp"
#include "app/machine.hpp"
#include "app/output_csv.hpp"
#include "app/output_file.hpp"
#include "app/output_json.hpp"
#include "app/output_summary.hpp"
#include "app/reference_error.hpp"
#include "app/scene_choice.hpp"
#include "app/scene_template.hpp"
#include "app/text.hpp"
#include "core/base/error.hpp"
#include "core/build_info.hpp"
#include "core/solve/dense_output.hpp"
#include "core/solve/switch_errors.hpp"
#include "report/page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <tuple>
#include <vector>

namespace bromwich::app {

namespace {

/// The smallest relative tolerance; 0 if there is none.
double smallest_tolerance(const Options& o) {
  double smallest = 0;
  for (const double one : {o.tolerance, o.tolerance_x, o.tolerance_y})
    if (one > 0 && (smallest == 0 || one < smallest)) smallest = one;
  return smallest;
}

Options solve_options(const SolveArguments& arguments, const SceneChoice& choice) {
  Options options;
  options.method = parse_method(arguments.method);
  if (!arguments.steps.empty()) options.steps = parse_steps(arguments.steps);
  options.event_location = arguments.event_location;
  parse_error_control(arguments, options);
  if (const double smallest = smallest_tolerance(options); smallest > 0) {
    // A smaller iteration error than the tolerance needs would waste sweeps. A thousandth of it does not affect the
    // differences of grids.
    options.iteration_tolerance = std::max(1e-3 * smallest, options.iteration_tolerance);
  }
  if (!arguments.iteration_tolerance.empty())
    options.iteration_tolerance = parse_iteration_tolerance(arguments.iteration_tolerance);
  options.goal = goal_options(arguments.goal, options.method, choice.quantity);
  const bool given = !arguments.states.empty();
  const bool only_x = options.tolerance_x > 0 && !given && choice.states == "none";
  parse_states("--states", only_x ? "all" : given ? arguments.states : choice.states, choice.scene.states(), options);
  if (options.tolerance_x > 0 && options.states == StateSelection::none)
    throw Error("--tol-x", "found without states", "add --states all or a list");
  return options;
}

/// If there are few states, they are computed for the comparison with a reference.
constexpr Index most_reference_states = 64;
constexpr std::size_t most_decisions = 100;

/// A result must not replace the scene file or one of its tables or matrices.
void keep_inputs(const SceneChoice& choice, const std::string& argument, const std::string& out) {
  std::error_code none;
  for (const std::filesystem::path& input : choice.inputs)
    if (std::filesystem::equivalent(input, out, none))
      throw Error(argument, fmt::format("'{}' is an input of the scene", out), "choose another file");
}

/// The output files, opened before anything is computed.
struct Outputs {
  std::optional<OutputFile> out, switches, report;
  std::vector<double> times;  ///< of the rows of `out`; empty = the time points
};

Outputs outputs(const SolveArguments& arguments, const SceneChoice& choice) {
  if (!arguments.at.empty() && arguments.out.empty())
    throw Error("--at", fmt::format("found '{}' without --out", arguments.at), "add --out FILE.csv");
  if (!arguments.out.empty() && arguments.out == arguments.switches)
    throw Error("--switches", fmt::format("'{}' is the file of --out", arguments.switches), "choose another file");
  Outputs made;
  if (!arguments.at.empty()) made.times = parse_times(arguments.at, choice.scene.T);
  for (auto [argument, name, file] : {std::tuple{"--out", &arguments.out, &made.out},
                                      std::tuple{"--switches", &arguments.switches, &made.switches}}) {
    if (name->empty()) continue;
    keep_inputs(choice, argument, *name);
    file->emplace(argument, *name, ".csv");
  }
  if (!arguments.report.empty()) {
    keep_inputs(choice, "--report", arguments.report);
    made.report.emplace("--report", arguments.report, ".html");
  }
  return made;
}

/// Printed before anything is computed.
void check_energies(const SolveArguments& arguments, const Scene& scene, const Options& options) {
  if (!arguments.energies) return;
  const auto refuse = [](const char* found, const char* remedy) { throw Error("--energies", found, remedy); };
  if (arguments.out.empty()) refuse("is given without --out", "add --out FILE.csv");
  if (!arguments.at.empty()) refuse("is given with --at", "leave one of them out");
  if (!scene.port) refuse("the scene is not port-Hamiltonian", "leave it out");
  if (options.method == Method::goal) return;
  if (scene.constraints() > 0) refuse("the scene has complementarity", "use --method goal, which counts its power");
  if (options.states != StateSelection::all) refuse("not all states are computed", "add --states all");
}

void write(const Outputs& outputs, const Scene& scene, Backend& backend, const Options& options, const Result& result,
           bool with_energies) {
  if (outputs.out) {
    std::optional<Energies> balance;
    if (with_energies && (result.goal ? result.goal->balance.energy.size() > 0 : result.status == Status::solved))
      balance = energies(scene, result);
    const bool sampled = !outputs.times.empty() && result.y.rows() == result.steps + 1;
    const Result rows = sampled ? at_times(scene, backend, result, outputs.times) : Result{};
    outputs.out->write([&](std::FILE* file) {
      write_csv(sampled ? rows : result, result, scene.constraints(), file, balance ? &*balance : nullptr);
    });
  }
  if (!outputs.switches) return;
  std::vector<Switch> found = switches_with_errors(scene, backend, options, result);
  const std::vector<Index>& free = scene.free_rows;  // their y changes sign without a switch
  std::erase_if(found, [&](const Switch& s) { return std::binary_search(free.begin(), free.end(), s.component); });
  outputs.switches->write([&](std::FILE* file) { write_switches_csv(found, result, file); });
}

Index state_columns(const Options& options, const Scene& scene) {
  return options.states == StateSelection::all ? scene.states() : Index(options.components.size());
}

/// Progress on a terminal, log lines, Ctrl-C; decisions at level info are kept for the summary.
void listen(const SolveArguments& arguments, ProgressLine& progress, std::vector<std::string>& decisions,
            Options& options) {
  if (progress.visible()) options.progress = [&progress](const Progress& state) { progress.show(state); };
  catch_interrupts();
  options.interrupted = interrupted;
  options.log = [&decisions,
                 log = make_log(arguments.log_level, [&progress] { progress.clear(); })](const LogEntry& e) {
    if (e.level >= LogLevel::info && decisions.size() < most_decisions) decisions.push_back(one_line(e.text));
    if (log) log(e);
  };
}

void write_report(const OutputFile& file, const SceneChoice& choice, const Result& result, const Json& object) {
  const std::string page = report::page(
      {object, report::as_table(choice.scene, result), "bromwich solve " + choice.scene.name, build_info::version});
  file.write([&page](std::FILE* out) { std::fwrite(page.data(), 1, page.size(), out); });
}

void report_status(const Result& result) {
  const std::string reason = result.reason.empty() ? "no reason was given" : one_line(result.reason);
  complain(fmt::format("{}: {}", to_string(result.status), reason));
}

}  // namespace

int run_solve(const SolveArguments& arguments) {
  if (arguments.print_template) {
    if (!arguments.words.empty())
      throw Error("--template", "found together with a SCENE", "use it alone: bromwich solve --template > my.toml");
    print(scene_template);
    return exit_solved;
  }
  const Words words = split_words(arguments.words, arguments.settings);
  const ParameterValues settings = parse_settings(words.settings);
  const SceneChoice choice = choose_scene(scene_name(words), settings);
  Options options = solve_options(arguments, choice);
  const int threads = arguments.threads.empty() ? 0 : parse_threads(arguments.threads);
  const Index columns = state_columns(options, choice.scene);
  check_memory(choice.scene, options.steps > 0 ? options.steps : choice.scene.default_steps, columns);
  check_energies(arguments, choice.scene, options);
  if (options.method == Method::goal && !arguments.at.empty())
    throw Error("--at", fmt::format("found '{}' with method goal", arguments.at),
                "omit it: the result is given on its own grid");
  const Outputs files = outputs(arguments, choice);

  const auto backend = choose_backend(arguments.backend, choice.scene, options, columns, threads);
  ProgressLine progress(options.iteration_tolerance);
  std::vector<std::string> decisions;
  listen(arguments, progress, decisions, options);
  options.memory_limit = memory_bytes();
  const bool states_for_reference =
      options.states == StateSelection::none && has_reference(choice) && choice.scene.states() <= most_reference_states;
  if (states_for_reference) {
    options.states = StateSelection::all;
    options.control_states = false;
  }
  const bool trace_for_report = files.report && choice.scene.constraints() > 0;
  options.trace = trace_for_report;
  Result result = solve(choice.scene, *backend, options);
  progress.finish();
  if (!choice.warning.empty()) add_warning(result, choice.warning);
  const ReferenceError error = reference_error(choice, *backend, result);
  if (states_for_reference) {  // the user did not request them
    result.x_components.clear();
    result.x.resize(result.y.rows(), 0);
  }

  write(files, choice.scene, *backend, options, result, arguments.energies);
  const int used = backend->device().threads;
  const Json object = to_json(choice, result, used, error, {options, decisions});
  if (files.report) write_report(*files.report, choice, result, object);
  print(arguments.json ? dump(object) : summary(choice, result, used, error, arguments.out));
  if (result.status == Status::solved) return exit_solved;
  report_status(result);
  return exit_not_solved;
}

}  // namespace bromwich::app

// `bromwich solve`: everything that can be refused is refused before the first step is computed.

#include "app/arguments.hpp"
#include "app/commands.hpp"
#include "app/interaction.hpp"
#include "app/output_csv.hpp"
#include "app/output_file.hpp"
#include "app/output_json.hpp"
#include "app/output_summary.hpp"
#include "app/scene_choice.hpp"
#include "app/text.hpp"
#include "core/error.hpp"
#include "cpu/cpu_backend.hpp"

#include <fmt/format.h>

#include <optional>

namespace bromwich::app {

namespace {

void refuse_unavailable(const SolveArguments& arguments) {
  if (!arguments.tolerance.empty())
    throw Error("--tol", fmt::format("found '{}' but error control is not available yet", arguments.tolerance),
                "use --steps J");
  if (!arguments.report.empty())
    throw Error("--report", fmt::format("found '{}' but reports are not available yet", arguments.report),
                "use --out FILE.csv or --json");
}

std::string scene_name(const Words& words) {
  if (words.names.empty()) throw Error("SCENE", "found none", "name a scene; 'bromwich scenes' lists them");
  if (words.names.size() > 1)
    throw Error("SCENE", "found " + join(words.names), "name one scene; options start with --");
  return words.names.front();
}

Options solve_options(const SolveArguments& arguments, const Scene& scene) {
  Options options;
  options.method = parse_method(arguments.method);
  if (!arguments.steps.empty()) options.steps = parse_steps(arguments.steps);
  if (!arguments.iteration_tolerance.empty())
    options.iteration_tolerance = parse_iteration_tolerance(arguments.iteration_tolerance);
  parse_states(arguments.states, scene.states(), options);
  return options;
}

Index state_columns(const Options& options, const Scene& scene) {
  return options.states == StateSelection::all ? scene.states() : Index(options.components.size());
}

void report_status(const Result& result) {
  const std::string reason = result.reason.empty() ? "no reason was given" : one_line(result.reason);
  fmt::print(stderr, "bromwich: {}: {}\n", to_string(result.status), reason);
}

}  // namespace

int run_solve(const SolveArguments& arguments) {
  refuse_unavailable(arguments);
  const Words words = split_words(arguments.words, arguments.settings);
  const ParameterValues settings = parse_settings(words.settings);
  const SceneChoice choice = choose_scene(scene_name(words), settings);
  Options options = solve_options(arguments, choice.scene);
  parse_backend(arguments.backend);
  const int threads = arguments.threads.empty() ? 0 : parse_threads(arguments.threads);
  check_memory(choice.scene, options.steps > 0 ? options.steps : choice.scene.default_steps,
               state_columns(options, choice.scene));
  std::optional<OutputFile> out;
  if (!arguments.out.empty()) out.emplace(arguments.out, ".csv");

  const auto backend = make_cpu_backend(threads);
  ProgressLine progress;
  if (progress.visible()) options.progress = [&progress](const Progress& state) { progress.show(state); };
  catch_interrupts();
  options.interrupted = interrupted;
  const Result result = solve(choice.scene, *backend, options);
  progress.clear();

  if (out) out->write([&](std::FILE* file) { write_csv(result, choice.scene.constraints(), file); });
  const int used = backend->device().threads;
  print(arguments.json ? dump(to_json(choice, result, used)) : summary(choice, result, used, arguments.out));
  if (result.status == Status::solved) return exit_solved;
  report_status(result);
  return exit_not_solved;
}

}  // namespace bromwich::app

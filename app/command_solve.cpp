// `bromwich solve`: all input is checked before the first step is computed.

#include "app/arguments.hpp"
#include "app/backend_choice.hpp"
#include "app/circuit_output.hpp"
#include "app/columns.hpp"
#include "app/command_map.hpp"
#include "app/command_sweep.hpp"
#include "app/commands.hpp"
#include "app/goal_arguments.hpp"
#include "app/interaction.hpp"
#include "app/log.hpp"
#include "app/machine.hpp"
#include "app/mechanism_output.hpp"
#include "app/nonlinear_solve.hpp"
#include "app/output_file.hpp"
#include "app/output_json.hpp"
#include "app/output_summary.hpp"
#include "app/parts_run.hpp"
#include "app/ranks.hpp"
#include "app/reference_error.hpp"
#include "app/result_facts.hpp"
#include "app/result_output.hpp"
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

/// The states of --states, or of the scene, and those of the columns. N x between time points takes the state there.
void choose_states(const SolveArguments& arguments, const SceneChoice& choice, const std::vector<Column>& columns,
                   Options& options) {
  const bool given = !arguments.states.empty();
  const std::vector<Index> in_columns = states_of(columns);
  const bool by_columns = !given && !columns.empty();
  const bool only_x = options.tolerance_x > 0 && !given && !by_columns && choice.states == "none";
  if (!by_columns)
    parse_states("--states", only_x ? "all" : given ? arguments.states : choice.states, choice.scene, options);
  if (has_contacts(columns)) options.states = StateSelection::all;
  if (options.states != StateSelection::all && !in_columns.empty()) {
    options.states = StateSelection::list;
    for (const Index i : in_columns)
      if (std::find(options.components.begin(), options.components.end(), i) == options.components.end())
        options.components.push_back(i);
  }
  if (options.tolerance_x > 0 && options.states == StateSelection::none)
    throw Error("--tol-x", "found without states", "add --states all or a list");
  options.trace = need_trace(columns);
  if (options.trace && !arguments.at.empty() && options.states == StateSelection::none) {
    options.states = StateSelection::list;
    options.components = {0};
    options.control_states = false;
  }
}

Options solve_options(const SolveArguments& arguments, const SceneChoice& choice, const std::vector<Column>& columns) {
  Options options;
  if (choice.circuit && !arguments.states.empty())
    throw Error("--states", "is given with a netlist, whose results are V(node) and I(element)",
                "choose some with --columns 'V(out),I(L1)'");
  if (!choice.system) options.method = parse_method(arguments.method);
  if (!arguments.steps.empty()) options.steps = parse_steps(arguments.steps);
  options.event_location = arguments.event_location;
  if (!arguments.nodes.empty()) options.tuning.literal_nodes = parse_nodes(arguments.nodes, options.method);
  options.confirm = !arguments.no_confirm;
  parse_error_control(arguments, options, choice.scene, choice.circuit != nullptr);
  if (const double smallest = smallest_tolerance(options); smallest > 0 && options.method != Method::goal) {
    // A smaller iteration error than the tolerance needs would waste sweeps. A thousandth of it does not affect the
    // differences of grids.
    options.iteration_tolerance = std::max(1e-3 * smallest, options.iteration_tolerance);
  }
  if (!arguments.iteration_tolerance.empty())
    options.iteration_tolerance = parse_iteration_tolerance(arguments.iteration_tolerance);
  options.goal = goal_options(arguments.goal, options.method, choice.quantity);
  if (arguments.no_confirm && controls_error(options))
    throw Error("--no-confirm", "is given with a tolerance, which compares grids", "leave one of them out");
  choose_states(arguments, choice, columns, options);
  if (options.method == Method::goal && options.trace)
    throw Error("--columns", "asks for w or N x with method goal", "leave w and trace out");
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
  std::optional<ResultOutput> out;
  std::optional<OutputFile> switches, report;
  std::optional<Scene> circuit;  ///< the outputs of a circuit, whose rows are written in place of those of the scene
  std::vector<Probe> probes;     ///< behind these outputs
  std::vector<double> times;     ///< of the rows of `out`; empty = the time points
  std::vector<Column> columns;   ///< of a CSV file; empty: y and the recorded states
  std::optional<ContactReport> contacts;

  const Scene& scene(const SceneChoice& choice) const { return circuit ? *circuit : choice.scene; }
};

void open_outputs(const SolveArguments& arguments, const SceneChoice& choice, Outputs& made) {
  if (!arguments.at.empty() && arguments.out.empty())
    throw Error("--at", fmt::format("found '{}' without --out", arguments.at), "add --out FILE.csv");
  if (!arguments.columns.empty() && arguments.out.empty())
    throw Error("--columns", fmt::format("found '{}' without --out", arguments.columns), "add --out FILE.csv");
  if (!arguments.out.empty() && arguments.out == arguments.switches)
    throw Error("--switches", fmt::format("'{}' is the file of --out", arguments.switches), "choose another file");
  if (!arguments.at.empty()) made.times = parse_times(arguments.at, choice.scene.T);
  if (choice.circuit && arguments.at.empty() && arguments.steps.empty())
    made.times.assign(choice.circuit->times.begin(), choice.circuit->times.end());
  if (!arguments.out.empty()) {
    keep_inputs(choice, "--out", arguments.out);
    made.out.emplace("--out", arguments.out, made.scene(choice), choice.rectangle);
  }
  if (!arguments.report.empty()) {
    keep_inputs(choice, "--report", arguments.report);
    made.report.emplace("--report", arguments.report, ".html");
  }
  if (arguments.switches.empty()) return;
  keep_inputs(choice, "--switches", arguments.switches);
  made.switches.emplace("--switches", arguments.switches, ".csv");
}

/// The names of the files of a run, for its summary.
std::string written(const SolveArguments& arguments) {
  std::vector<std::string> names;
  for (const std::string& name : {arguments.out, arguments.switches, arguments.report})
    if (!name.empty()) names.push_back(name);
  return join(names);
}

/// Printed before anything is computed.
void check_energies(const SolveArguments& arguments, const Scene& scene, const Options& options) {
  if (!arguments.energies) return;
  const auto refuse = [](const char* found, const char* remedy) { throw Error("--energies", found, remedy); };
  if (arguments.out.empty()) refuse("is given without --out", "add --out FILE.csv");
  if (result_format("--out", arguments.out) == ResultFormat::vtkhdf)
    refuse("is given with a file of fields", "add --out FILE.csv, FILE.h5 or FILE.npz");
  if (!arguments.at.empty()) refuse("is given with --at", "leave one of them out");
  if (!scene.port) refuse("the scene is not port-Hamiltonian", "leave it out");
  if (options.method == Method::goal) return;
  if (scene.constraints() > 0) refuse("the scene has complementarity", "use --method goal, which counts its power");
  if (options.states != StateSelection::all) refuse("not all states are computed", "add --states all");
}

/// `system`: the run of a nonlinear system, or null.
void write(Outputs& outputs, const SceneChoice& choice, Backend& backend, const Options& options, const Result& result,
           bool with_energies, const Facts& facts, const NonlinearRun* system) {
  const Scene& scene = choice.scene;
  if (outputs.out) {
    std::optional<Energies> balance;
    if (with_energies && (result.goal ? result.goal->balance.energy.size() > 0 : result.status == Status::solved))
      balance = energies(scene, result);
    const bool sampled = !outputs.times.empty() && result.y.rows() == result.steps + 1;
    Result rows;
    if (sampled) rows = system ? system->at(outputs.times) : at_times(scene, backend, result, outputs.times);
    if (sampled && system) keep_states(rows, result.x_components);
    if (choice.circuit) rows = output_result(*choice.circuit, sampled ? rows : result, outputs.probes);
    const Result& written = sampled || choice.circuit ? rows : result;
    std::vector<TimeSeries> contacts;
    if (outputs.contacts) contacts = contact_series(*choice.mechanism, *outputs.contacts, written);
    const auto columns = outputs.columns.empty()
                             ? default_columns(outputs.scene(choice), written.x_components,
                                               contact_names(contacts.empty() ? nullptr : choice.mechanism.get()))
                             : outputs.columns;
    outputs.out->write(written, result, columns, contacts, balance ? &*balance : nullptr, facts);
  }
  if (!outputs.switches) return;
  std::vector<Switch> found = system ? system->switches() : switches_with_errors(scene, backend, options, result);
  const std::vector<Index>& free = scene.free_rows;  // their y changes sign without a switch
  std::erase_if(found, [&](const Switch& s) { return std::binary_search(free.begin(), free.end(), s.component); });
  outputs.switches->write([&](std::FILE* file) { write_switches_csv(scene, found, result, file); });
}

Index state_columns(const Options& options, const Scene& scene) {
  return options.states == StateSelection::all ? scene.states() : Index(options.components.size());
}

/// Progress on a terminal, log lines, Ctrl-C; decisions at level info are kept for the summary.
void listen(const SolveArguments& arguments, ProgressLine& progress, std::vector<std::string>& decisions,
            Options& options) {
  if (progress.visible()) options.progress = [&progress](const Progress& state) { progress.show(state); };
  if (ranks().size() == 1) {  // ranks would stop at different sweeps
    catch_interrupts();
    options.interrupted = interrupted;
  }
  const std::string level = first_rank() ? arguments.log_level : "off";
  options.log = [&decisions, log = make_log(level, [&progress] { progress.clear(); })](const LogEntry& e) {
    if (e.level >= LogLevel::info && decisions.size() < most_decisions) decisions.push_back(one_line(e.text));
    if (log) log(e);
  };
}

void write_report(const Outputs& outputs, const SceneChoice& choice, const Result& result, const Json& object) {
  const auto table = choice.circuit
                         ? report::as_table(*outputs.circuit, output_result(*choice.circuit, result, outputs.probes))
                         : report::as_table(choice.scene, result);
  const std::string page = report::page({object, table, "bromwich solve " + choice.scene.name, build_info::version});
  outputs.report->write([&page](std::FILE* out) { std::fwrite(page.data(), 1, page.size(), out); });
}

void report_status(const Result& result) {
  const std::string reason = result.reason.empty() ? "no reason was given" : one_line(result.reason);
  complain(fmt::format("{}: {}", to_string(result.status), reason));
}

/// The whole run at once. Without requested states those of few are computed for the comparison with a reference.
Result solve_whole(const SceneChoice& choice, Backend& backend, Options& options, const Outputs& files,
                   ReferenceError& error) {
  const bool trace_for_report = files.report && choice.scene.constraints() > 0;
  options.trace = options.trace || trace_for_report || (files.out && files.out->with_slack());
  const bool states_for_reference =
      options.states == StateSelection::none && has_reference(choice) && choice.scene.states() <= most_reference_states;
  if (states_for_reference) {
    options.states = StateSelection::all;
    options.control_states = false;
  }
  Result result = solve(choice.scene, backend, options);
  error = reference_error(choice, backend, result);
  if (states_for_reference) {  // the user did not request them
    result.x_components.clear();
    result.x.resize(result.y.rows(), 0);
  }
  return result;
}

/// A nonlinear system, with the states that were asked for.
Result solve_system(const SceneChoice& choice, Backend& backend, const Options& options,
                    const SolveArguments& arguments, std::optional<NonlinearRun>& system, ReferenceError& error) {
  system.emplace(choice, backend, nonlinear_options(arguments, options));
  Result result = system->result();
  error = reference_error(choice, backend, result);
  keep_states(result, recorded_components(choice.scene, options));
  return result;
}

/// What --checkpoint and --restart ask for; checked before anything is computed.
std::optional<PartsOptions> parts_options(const SolveArguments& a, const SceneChoice& choice, Options& options) {
  if (!a.checkpoint_every.empty() && a.checkpoint.empty())
    throw Error("--checkpoint-every", "is given without --checkpoint", "add --checkpoint FILE.h5");
  if (a.checkpoint.empty() && a.restart.empty()) return std::nullopt;
  const std::string argument = a.checkpoint.empty() ? "--restart" : "--checkpoint";
  for (const auto& [name, given] : {std::pair("--at", !a.at.empty()),
                                    {"--switches", !a.switches.empty()},
                                    {"--energies", a.energies},
                                    {"--report", !a.report.empty()},
                                    {"--event-location", a.event_location}})
    if (given)
      throw Error(argument, fmt::format("is given with {}, which needs the whole result", name),
                  "leave one of them out");
  if (choice.circuit)
    throw Error(argument, "is given with a netlist", "leave it out: its results are made of the whole solution");
  prepare_parts(argument, choice.scene, options);
  PartsOptions parts;
  if (!a.checkpoint_every.empty()) parts.seconds = parse_seconds("--checkpoint-every", a.checkpoint_every);
  if (!a.checkpoint.empty()) parts.checkpoint.emplace("--checkpoint", a.checkpoint, ".h5");
  parts.scene = fingerprint(choice, options);
  parts.run = new_run();
  if (!a.out.empty() && a.out == a.checkpoint)
    throw Error("--checkpoint", fmt::format("'{}' is the file of --out", a.checkpoint), "choose another file");
  if (!a.restart.empty()) read_restart(a.restart, parts);
  return parts;
}

/// Creates a growing file of results, or continues that of the run before.
void begin(const SolveArguments& arguments, const SceneChoice& choice, const Options& options,
           const PartsOptions* parts, Outputs& files) {
  if (!files.out) return;
  if (parts && !files.out->grows())
    throw Error(
        "--out",
        fmt::format("'{}' is written at the end of a run, and checkpoints are for long ones", files.out->name()),
        "choose a file .h5 or .vtkhdf");
  const std::vector<Index> states = recorded_components(files.scene(choice), options);
  files.out->check_states(states);
  if (parts && parts->from && files.out->exists()) return files.out->resume(states, parts->from->row + 1, parts->run);
  const Index steps = steps_of(choice.scene, options);
  const Index rows = files.times.empty() ? steps + 1 : Index(files.times.size());
  files.out->begin(states, rows, facts_of_run(arguments, choice, options, parts ? parts->run : new_run()));
  if (parts && parts->from) append_start(choice.scene, *parts->from, *files.out);
}

// --template and --schema stand alone.
int print_text(const SolveArguments& arguments) {
  const char* option = arguments.print_template ? "--template" : "--schema";
  if (!arguments.words.empty() || (arguments.print_template && arguments.print_schema))
    throw Error(option, arguments.words.empty() ? "found together with --schema" : "found together with a SCENE",
                fmt::format("use it alone: bromwich solve {} > {}", option,
                            arguments.print_template ? "my.toml" : "scene.schema.json"));
  print(arguments.print_template ? scene_template : scene_schema);
  return exit_solved;
}

// Refuses what does not fit into memory or does not go together.
void check_run(const SolveArguments& arguments, const SceneChoice& choice, const Options& options, Index recorded) {
  // A nonlinear system has all states, phi and their linear solution at all time points, but for functions of N x.
  const bool all_states = choice.system && !choice.system->of_trace;
  check_memory(choice.scene, steps_of(choice.scene, options), all_states ? 3 * choice.scene.states() : recorded);
  if (choice.system) nonlinear_options(arguments, options);  // refuses what does not apply
  check_energies(arguments, choice.scene, options);
  if (options.method == Method::goal && !arguments.at.empty())
    throw Error("--at", fmt::format("found '{}' with method goal", arguments.at),
                "omit it: the result is given on its own grid");
}

}  // namespace

int run_solve(const SolveArguments& arguments) {
  if (arguments.print_template || arguments.print_schema) return print_text(arguments);
  const Words words = split_words(arguments.words, arguments.settings);
  const ParameterValues settings = parse_settings(words.settings, scene_name(words));
  if (const auto code = run_map(arguments, scene_name(words), settings)) return *code;
  if (const auto code = run_sweep(arguments, scene_name(words), settings)) return *code;
  const SceneChoice choice = arguments.periodic.empty()
                                 ? choose_scene_or_system(scene_name(words), settings)
                                 : choose_periodic_circuit(scene_name(words), settings, arguments.periodic);
  Outputs files;
  if (choice.circuit) {
    if (!arguments.columns.empty()) files.columns = circuit_columns(arguments.columns, *choice.circuit, files.probes);
    files.circuit = output_scene(*choice.circuit, files.probes);
    for (const std::string& note : choice.circuit->notes) complain(note);
  }
  if (!choice.circuit && !arguments.columns.empty())
    files.columns = parse_columns(arguments.columns, choice.scene, contact_names(choice.mechanism.get()));
  Options options = solve_options(arguments, choice, choice.circuit ? std::vector<Column>{} : files.columns);
  const int threads = threads_of_rank(arguments.threads.empty() ? 0 : parse_threads(arguments.threads));
  const Index recorded = state_columns(options, choice.scene);
  check_run(arguments, choice, options, recorded);
  open_outputs(arguments, choice, files);
  std::optional<PartsOptions> parts = parts_options(arguments, choice, options);

  const auto backend = over_ranks(choose_backend(arguments.backend, choice.scene, options, recorded, threads));
  ProgressLine progress(options.iteration_tolerance);
  std::vector<std::string> decisions;
  listen(arguments, progress, decisions, options);
  options.memory_limit = memory_bytes();
  begin(arguments, choice, options, parts ? &*parts : nullptr, files);
  ReferenceError error;
  std::optional<NonlinearRun> system;
  Result result = parts ? solve_in_parts(choice.scene, *backend, options, *parts, files.out ? &*files.out : nullptr)
                  : choice.system ? solve_system(choice, *backend, options, arguments, system, error)
                                  : solve_whole(choice, *backend, options, files, error);
  progress.finish();
  if (!choice.warning.empty()) add_warning(result, choice.warning);

  const int used = backend->device().threads;
  Json object = to_json(choice, result, used, error, {options, decisions});
  if (system) {
    object["method"] = system->method();
    object["nonlinear"] = system->json();
  }
  CircuitNumbers numbers;
  if (choice.circuit) numbers = circuit_numbers(*choice.circuit, *backend, result);
  add_circuit_json(numbers, object);
  std::string of_contacts;
  if (choice.mechanism && (files.contacts = report_on_contacts(*choice.mechanism, result, object)))
    of_contacts = mechanism_text(*choice.mechanism, *files.contacts);
  const Facts facts = facts_of_result(result, used, object);
  if (!parts) write(files, choice, *backend, options, result, arguments.energies, facts, system ? &*system : nullptr);
  if (parts && files.out) files.out->finish(facts);
  if (files.report) write_report(files, choice, result, object);
  print(arguments.json ? dump(object)
                       : summary(choice, result, used, error, written(arguments), system ? system->method() : "") +
                             circuit_text(numbers) + of_contacts);
  if (result.status == Status::solved) return exit_solved;
  report_status(result);
  return exit_not_solved;
}

}  // namespace bromwich::app

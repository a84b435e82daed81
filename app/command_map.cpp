#include "app/command_map.hpp"

#include "app/arguments.hpp"
#include "app/backend_choice.hpp"
#include "app/interaction.hpp"
#include "app/measures.hpp"
#include "app/output_file.hpp"
#include "app/output_json.hpp"
#include "app/ranks.hpp"
#include "app/scene_choice.hpp"
#include "app/text.hpp"
#include "circuits/operating_map.hpp"
#include "core/base/error.hpp"
#include "core/base/timer.hpp"
#include "core/build_info.hpp"
#include "files/number_files.hpp"
#include "files/sweep_file.hpp"
#include "report/sweep_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <map>

namespace bromwich::app {

namespace {

namespace fs = std::filesystem;

void check_map_arguments(const SolveArguments& a, const Circuit& circuit) {
  for (const auto& [option, given] : {std::pair("--at", !a.at.empty()),
                                      {"--switches", !a.switches.empty()},
                                      {"--checkpoint", !a.checkpoint.empty()},
                                      {"--restart", !a.restart.empty()},
                                      {"--states", !a.states.empty()},
                                      {"--energies", a.energies},
                                      {"--event-location", a.event_location}})
    if (given)
      throw Error(option, "is given with a netlist that has .step",
                  fmt::format("leave it out, or fix the parameters, --set {}=VALUE", circuit.steps[0].name));
  if (ranks().size() > 1)
    throw Error("SCENE", "a netlist with .step is solved by one process", "start it without ranks");
  for (const fs::path& input : circuit.inputs)
    for (const auto& [option, file] : {std::pair("--out", &a.out), {"--report", &a.report}}) {
      std::error_code none;
      if (!file->empty() && fs::equivalent(input, *file, none))
        throw Error(option, fmt::format("'{}' is an input of the scene", *file), "choose another file");
    }
  const std::string extension = fs::path(a.out).extension();
  if (!a.out.empty() && extension != ".csv" && extension != ".h5")
    throw Error("--out", fmt::format("'{}' does not end in .csv or .h5", a.out), "choose such a file");
}

void add_map_number(std::string& text, double value) {
  text += std::isnan(value) ? std::string(",nan") : fmt::format(",{}", value + 0.0);  // -0 becomes 0
}

std::string quoted_cell(const std::string& cell) {
  std::string text = "\"";
  for (const char c : cell) text.append(c == '"' ? 2 : 1, c);
  return text + '"';
}

/// The table of a sweep, as app/sweep_table.hpp writes it.
std::string map_table(const OperatingMap& map) {
  std::string text = "scene";
  for (const CircuitStep& s : map.steps) text += "," + s.name;
  text += ",status,residual";
  for (const std::string& name : map.columns)
    text += "," + (name.find_first_of(",\"") == std::string::npos ? name : quoted_cell(name));
  text += ",reason,warning\n";
  for (Index i = 0; i < map.points(); ++i) {
    text += std::to_string(i);
    for (Index k = 0; k < map.settings.cols(); ++k) add_map_number(text, map.settings(i, k));
    text += fmt::format(",{}", to_string(map.status[std::size_t(i)]));
    add_map_number(text, map.residual[i]);
    for (Index k = 0; k < map.values.cols(); ++k) add_map_number(text, map.values(i, k));
    text += "," + quoted_cell(map.reason[std::size_t(i)]) + ",\"\"\n";
  }
  return text;
}

std::vector<std::string> map_names(const OperatingMap& map) {
  std::vector<std::string> names;
  for (const CircuitStep& s : map.steps) names.push_back(s.name);
  return names;
}

std::vector<std::string> map_statuses(const OperatingMap& map) {
  std::vector<std::string> all;
  for (const Status s : map.status) all.emplace_back(to_string(s));
  return all;
}

void write_map_hdf5(const std::string& name, const OperatingMap& map, const Facts& facts, const Backend& backend) {
  ResultColumns columns;  // one row a point, of y
  columns.constraints = Index(map.columns.size());
  columns.constraint_names = map.columns;
  const Sweep sweep{map_names(map), map.settings, {}, {}, {}};
  const auto file = create_sweep_hdf5({"--out", name}, columns, sweep, Vector::Zero(1));
  const RowMatrix none(map.points(), 0);
  file->append({map.settings, map.residual, map.values, none, none}, backend);
  file->finish(map_statuses(map), map.reason, std::vector<std::string>(std::size_t(map.points())), facts);
}

void write_map_file(const std::string& argument, const std::string& name, const std::string& extension,
                    const std::string& text) {
  OutputFile(argument, name, extension).write([&text](std::FILE* out) {
    std::fwrite(text.data(), 1, text.size(), out);
  });
}

struct MapRun {
  const SolveArguments& arguments;
  const std::string& scene;
  Circuit circuit;
  OperatingMap map = {};
  std::string backend = {};
  Timer timer = {};
  double seconds = 0;

  Index solved() const { return std::count(map.status.begin(), map.status.end(), Status::solved); }

  void write_files(const Backend& used) const {
    const Facts facts{{"title", circuit.scene.name},
                      {"backend", backend},
                      {"version", std::string(build_info::version)},
                      {"command", arguments.command_line}};
    if (fs::path(arguments.out).extension() == ".h5")
      write_map_hdf5(arguments.out, map, facts, used);
    else if (!arguments.out.empty())
      write_map_file("--out", arguments.out, ".csv", map_table(map));
    if (arguments.report.empty()) return;
    const StoredSweep stored{map_names(map), map.columns, map_statuses(map), map.settings, map.values};
    write_map_file("--report", arguments.report, ".html",
                   report::sweep_page(stored, fs::path(scene).filename().string(), build_info::version));
  }

  std::map<std::string, Index> counts() const {
    std::map<std::string, Index> found;
    for (const Status s : map.status) ++found[to_string(s)];
    return found;
  }

  /// The least and the largest value of a column, and where they are.
  std::string range(Index column) const {
    Index low = -1, high = -1;
    for (Index i = 0; i < map.points(); ++i) {
      const double v = map.values(i, column);
      if (!std::isfinite(v)) continue;
      if (low < 0 || v < map.values(low, column)) low = i;
      if (high < 0 || v > map.values(high, column)) high = i;
    }
    if (low < 0) return "no value";
    const auto at = [&](Index i) {
      std::vector<std::string> words;
      for (std::size_t k = 0; k < map.steps.size(); ++k)
        words.push_back(fmt::format("{} = {:.6g}", map.steps[k].name, map.settings(i, Index(k))));
      return fmt::format("{:.9g} {}at {}", map.values(i, column),
                         map.units[std::size_t(column)].empty() ? "" : map.units[std::size_t(column)] + " ",
                         join(words));
    };
    return at(low) + " to " + at(high);
  }

  std::string summary() const {
    std::string text = fmt::format("scene       {}, {} operating points over {}\n", circuit.scene.name, map.points(),
                                   join(map_names(map)));
    std::vector<std::string> words;
    for (const auto& [status, count] : counts()) words.push_back(fmt::format("{} {}", count, status));
    text += fmt::format("status      {}\n", join(words));
    for (Index i = 0; i < map.points(); ++i)
      if (const std::string& reason = map.reason[std::size_t(i)]; map.status[std::size_t(i)] != Status::solved) {
        text += fmt::format("first       point {}: {}\n", i, one_line(reason));
        break;
      }
    for (Index k = 0; k < map.values.cols(); ++k)
      text += fmt::format("{:<11} {}\n", map.columns[std::size_t(k)], range(k));
    text += fmt::format("time        {} on {}\n", format_seconds(seconds), backend);
    std::vector<std::string> files;
    for (const std::string& name : {arguments.out, arguments.report})
      if (!name.empty()) files.push_back(name);
    return text + fmt::format("output      {}\n",
                              files.empty()
                                  ? "none; --out FILE.csv writes a row for each point, --report FILE.html maps"
                                  : join(files));
  }

  Json json() const {
    Json object{{"scene", circuit.scene.name}, {"points", map.points()}, {"solved", solved()},
                {"columns", map.columns},      {"units", map.units},     {"seconds", seconds}};
    for (const CircuitStep& s : map.steps) object["steps"][s.name] = s.values;
    object["status"] = counts();
    return object;
  }
};

Options map_options(const SolveArguments& a, const Circuit& circuit) {
  constexpr double tolerance = 1e-4;
  Options options;
  options.method = parse_method(a.method);
  if (!a.steps.empty()) options.steps = parse_steps(a.steps);
  Scene scene = circuit.scene;
  scene.default_tolerance = tolerance;
  options.states = StateSelection::all;
  // Located switches need no rows of their own for numbers of a period.
  constexpr Index few = 16;
  const bool of_tolerance = !(a.tolerance.empty() && a.tolerance_x.empty() && a.tolerance_y.empty());
  if (scene.boundary && a.steps.empty() && !of_tolerance) options.steps = few;
  parse_error_control(a, options, scene, true);
  return options;
}

}  // namespace

std::optional<int> run_map(const SolveArguments& arguments, const std::string& scene, const ParameterValues& settings) {
  std::error_code failure;
  if (!is_netlist(scene) || !fs::is_regular_file(scene, failure)) return std::nullopt;
  const std::optional<double> period =
      arguments.periodic.empty() ? std::nullopt : std::optional(parse_period(arguments.periodic));
  MapRun run{arguments, scene, read_circuit(scene, settings, period)};
  if (run.circuit.steps.empty()) return std::nullopt;
  check_map_arguments(arguments, run.circuit);
  for (const std::string& note : run.circuit.notes) complain(note);
  Options options = map_options(arguments, run.circuit);
  const int threads = threads_of_rank(arguments.threads.empty() ? 0 : parse_threads(arguments.threads));
  const auto backend =
      choose_backend(arguments.backend, run.circuit.scene, options, run.circuit.scene.states(), threads);
  run.backend = backend->name();
  ProgressLine progress;
  if (progress.visible()) options.progress = [&progress](const Progress& p) { progress.show(p); };
  catch_interrupts();
  options.interrupted = interrupted;
  const std::string text = read_text({"SCENE", scene}, "SCENE"), name = fs::path(scene).filename().string();
  const fs::path folder = fs::path(scene).parent_path();
  const ReadCircuit read = [&](const std::map<std::string, double>& point) {
    std::map<std::string, double> all = settings;
    all.insert(point.begin(), point.end());
    return parse_circuit(text, name, folder, all, period);
  };
  const std::vector<std::string> columns =
      arguments.columns.empty() ? map_columns(run.circuit) : split_outside(arguments.columns);
  run.map = operating_map(read, run.circuit.steps, columns, options, *backend, backends_beside(*backend), "--columns");
  run.seconds = run.timer.lap();
  progress.finish();
  run.write_files(*backend);
  print(arguments.json ? dump(run.json()) : run.summary());
  if (run.solved() == run.map.points()) return exit_solved;
  complain(fmt::format("{} of {} operating points are not solved", run.map.points() - run.solved(), run.map.points()));
  return exit_not_solved;
}

}  // namespace bromwich::app

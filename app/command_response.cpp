// `bromwich response`: small signals of a circuit about its periodic state, over frequency.

#include "app/arguments.hpp"
#include "app/backend_choice.hpp"
#include "app/commands.hpp"
#include "app/measures.hpp"
#include "app/output_file.hpp"
#include "app/output_json.hpp"
#include "app/scene_choice.hpp"
#include "app/text.hpp"
#include "circuits/analysis.hpp"
#include "circuits/responses.hpp"
#include "core/base/error.hpp"
#include "core/build_info.hpp"
#include "core/solve/solve.hpp"
#include "report/response_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace bromwich::app {

namespace {

namespace fs = std::filesystem;

/// "dec 20 100 100k", or frequencies alone.
std::vector<double> parse_frequencies(const std::string& text) {
  std::vector<std::string> words = circuits::split_arguments(circuits::lower(text));
  std::string kind = "list";
  if (!words.empty() && !circuits::spice_number(words[0])) {
    kind = words[0];
    words.erase(words.begin());
  }
  std::vector<double> numbers;
  for (const std::string& word : words) {
    const auto value = circuits::spice_number(word);
    if (!value) throw Error("--frequencies", fmt::format("found '{}'", word), "give numbers, such as 100 or 1k");
    numbers.push_back(*value);
  }
  return circuits::frequencies_of(kind, numbers, "--frequencies");
}

void check_files(const ResponseArguments& a, const Circuit& circuit) {
  for (const fs::path& input : circuit.inputs)
    for (const auto& [option, file] : {std::pair("--out", &a.out), {"--report", &a.report}}) {
      std::error_code none;
      if (!file->empty() && fs::equivalent(input, *file, none))
        throw Error(option, fmt::format("'{}' is an input of the scene", *file), "choose another file");
    }
}

std::string hertz(double f) { return fmt::format("{:.6g} Hz", f); }

bool is_gain(const std::string& name) { return circuits::lower(name).starts_with("gain("); }

/// Of a gain its margins, of others the largest size.
std::string in_words(const Responses& r, Index k) {
  const std::string& unit = r.units[std::size_t(k)];
  if (is_gain(r.names[std::size_t(k)])) {
    const StabilityMargins m = stability_margins(r.frequencies, r.values.col(k));
    const std::string phase =
        std::isnan(m.crossover) ? "no crossover"
                                : fmt::format("crossover {}, phase margin {:.4g} degrees", hertz(m.crossover), m.phase);
    return phase + (std::isnan(m.phase_crossover)
                        ? ", no phase crossover"
                        : fmt::format(", gain margin {:.4g} dB at {}", m.gain, hertz(m.phase_crossover)));
  }
  Index at = 0;
  const double most = r.values.col(k).cwiseAbs().maxCoeff(&at);
  return fmt::format("{:.6g}{} at {}, at most {:.6g} at {}", std::abs(r.values(0, k)), unit.empty() ? "" : " " + unit,
                     hertz(r.frequencies.front()), most, hertz(r.frequencies[std::size_t(at)]));
}

report::ResponseCurves curves_of(const Responses& r, const std::string& state) {
  report::ResponseCurves c{r.names, r.units, Eigen::Map<const Vector>(r.frequencies.data(), r.values.rows()),
                           r.values.cwiseAbs(), RowMatrix(r.values.rows(), r.values.cols())};
  c.facts.emplace_back("periodic state", state);
  for (Index k = 0; k < r.values.cols(); ++k) {
    c.phases.col(k) = unwrapped_phase(r.values.col(k));
    c.facts.emplace_back(r.names[std::size_t(k)], in_words(r, k));
  }
  return c;
}

Json json_of(const Circuit& circuit, const Responses& r, const report::ResponseCurves& c) {
  Json object{{"scene", circuit.scene.name}, {"period", circuit.scene.T}, {"frequencies", r.frequencies}};
  for (Index k = 0; k < r.values.cols(); ++k) {
    const std::string& name = r.names[std::size_t(k)];
    const auto list = [](const auto& column) { return std::vector<double>(column.begin(), column.end()); };
    Json& one = object["responses"][name];
    one = {{"unit", r.units[std::size_t(k)]}, {"abs", list(c.sizes.col(k))}, {"phase", list(c.phases.col(k))}};
    if (!is_gain(name)) continue;
    const StabilityMargins m = stability_margins(r.frequencies, r.values.col(k));
    const auto number = [](double v) { return std::isfinite(v) ? Json(v) : Json(nullptr); };
    one["margins"] = {{"crossover", number(m.crossover)},
                      {"phase", number(m.phase)},
                      {"phase_crossover", number(m.phase_crossover)},
                      {"gain", number(m.gain)}};
  }
  return object;
}

void write(const std::optional<OutputFile>& file, const std::string& text) {
  if (file) file->write([&text](std::FILE* out) { std::fwrite(text.data(), 1, text.size(), out); });
}

}  // namespace

int run_response(const ResponseArguments& a) {
  const Words words = split_words(a.words, a.settings);
  const std::string scene = scene_name(words);
  if (!is_netlist(scene)) throw Error("SCENE", fmt::format("'{}' is no netlist", scene), "give a file .cir");
  const Circuit circuit =
      read_circuit(scene, parse_settings(words.settings, scene), a.periodic.empty() ? 0 : parse_period(a.periodic));
  check_files(a, circuit);
  const std::vector<double> frequencies =
      a.frequencies.empty() ? circuit.netlist->frequencies : parse_frequencies(a.frequencies);
  if (frequencies.empty())
    throw Error("--frequencies", "is not given, and the netlist has no .ac", "write 'dec 20 100 100k'");
  std::optional<OutputFile> table, page;
  if (!a.out.empty()) table.emplace("--out", a.out, ".csv");
  if (!a.report.empty()) page.emplace("--report", a.report, ".html");
  for (const std::string& note : circuit.notes) complain(note);

  Options options;
  options.states = StateSelection::all;
  constexpr Index few = 16;  // located switches need no rows of their own
  options.steps = few;
  const auto backend =
      choose_backend("cpu", circuit.scene, options, 0, a.threads.empty() ? 0 : parse_threads(a.threads));
  const Result state = solve(circuit.scene, *backend, options);
  if (state.status != Status::solved) {
    complain(fmt::format("the periodic state is not solved: {}", one_line(state.reason)));
    return exit_not_solved;
  }
  const std::vector<std::string> columns = a.columns.empty() ? std::vector<std::string>{} : split_outside(a.columns);
  const Responses found = responses(circuit, *backend, state, columns, a.source, frequencies, "--columns");
  const report::ResponseCurves curves =
      curves_of(found, fmt::format("of {}, {:.6g} s", circuit.scene.name, circuit.scene.T));
  write(table, report::response_table(curves));
  write(page, report::response_page(curves, fs::path(scene).filename().string(), build_info::version));
  if (a.json) {
    print(dump(json_of(circuit, found, curves)));
    return exit_solved;
  }
  std::string text = fmt::format("scene       {}, {} frequencies about its periodic state of {:.6g} s\n",
                                 circuit.scene.name, frequencies.size(), circuit.scene.T);
  for (Index k = 0; k < found.values.cols(); ++k)
    text += fmt::format("{:<11} {}\n", found.names[std::size_t(k)], in_words(found, k));
  std::vector<std::string> files;
  for (const std::string& name : {a.out, a.report})
    if (!name.empty()) files.push_back(name);
  print(text +
        fmt::format("output      {}\n", files.empty() ? "none; --out FILE.csv, --report FILE.html" : join(files)));
  return exit_solved;
}

}  // namespace bromwich::app

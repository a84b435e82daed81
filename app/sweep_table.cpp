#include "app/sweep_table.hpp"

#include "core/base/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

namespace bromwich::app {

void check_sweep_arguments(const SolveArguments& arguments, const ParameterValues& settings, const Sweep& sweep) {
  for (const auto& [option, given] : {std::pair("--switches", !arguments.switches.empty()),
                                      {"--report", !arguments.report.empty()},
                                      {"--checkpoint", !arguments.checkpoint.empty()},
                                      {"--energies", arguments.energies},
                                      {"--event-location", arguments.event_location}})
    if (given)
      throw Error(option, "is given for a scene with [sweep]", "leave it out, or take [sweep] out of the file");
  for (const std::string& name : sweep.names)
    if (settings.contains(name))
      throw Error("--set", fmt::format("'{}' is swept by the file", name), "leave it out, or take it out of [sweep]");
  for (const auto& [option, word] : {std::pair("--at", &arguments.at), {"--columns", &arguments.columns}})
    if (!word->empty() && arguments.out.empty())
      throw Error(option, fmt::format("found '{}' without --out", *word), "add --out FILE.csv");
  if (arguments.out.empty()) return;
  const std::string extension = std::filesystem::path(arguments.out).extension();
  if (extension != ".csv" && extension != ".h5")
    throw Error("--out", fmt::format("'{}' does not end in .csv or .h5", arguments.out), "choose such a file");
  std::error_code none;
  for (const std::filesystem::path& input : sweep.inputs)
    if (std::filesystem::equivalent(input, arguments.out, none))
      throw Error("--out", fmt::format("'{}' is an input of the scene", arguments.out), "choose another file");
}

std::string csv_number(double value) {
  return std::isnan(value) ? "nan" : fmt::format("{}", value + 0.0);  // -0 becomes 0
}

std::string csv_text(std::string text) {
  for (std::size_t at = 0; (at = text.find('"', at)) != std::string::npos; at += 2) text.insert(at, 1, '"');
  return '"' + text + '"';
}

Vector values_of(const BatchResult& result, const std::vector<Index>& states, const Column& c, Index place) {
  if (c.kind == ColumnKind::y) return result.of(result.y, place).col(c.component);
  if (c.kind == ColumnKind::w) return result.of(result.w, place).col(c.component);
  const auto found = std::find(states.begin(), states.end(), c.component);
  return result.of(result.x, place).col(found - states.begin());
}

}  // namespace bromwich::app

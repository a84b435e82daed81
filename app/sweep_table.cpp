#include "app/sweep_table.hpp"

#include "core/base/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <utility>

namespace bromwich::app {

void check_sweep_arguments(const SolveArguments& arguments, const ParameterValues& settings, const Sweep& sweep) {
  for (const auto& [option, given] : {std::pair("--switches", !arguments.switches.empty()),
                                      {"--report", !arguments.report.empty()},
                                      {"--checkpoint", !arguments.checkpoint.empty()},
                                      {"--energies", arguments.energies},
                                      {"--event-location", arguments.event_location},
                                      {"--no-confirm", arguments.no_confirm}})
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

namespace {

constexpr Index scenes_together = 64;  ///< of one thread

void add_number(std::string& text, double value) {
  text += ',';
  if (std::isnan(value))
    text += "nan";
  else
    fmt::format_to(std::back_inserter(text), "{}", value + 0.0);  // -0 becomes 0
}

// A cell with any characters.
void add_text(std::string& text, const std::string& cell) {
  text += ",\"";
  for (const char c : cell) text.append(c == '"' ? 2 : 1, c);
  text += '"';
}

}  // namespace

SweepTable::SweepTable(const Sweep& sweep, std::vector<Column> columns, std::vector<Measure> measures,
                       std::vector<Index> states, std::vector<double> times)
    : sweep_(sweep),
      columns_(std::move(columns)),
      measures_(std::move(measures)),
      states_(std::move(states)),
      times_(std::move(times)) {}

std::string SweepTable::header() const {
  const bool at = !times_.empty();
  std::string text = "scene";
  for (const std::string& name : sweep_.names) text += "," + name;
  text += at ? ",t,status,residual" : ",status,residual";
  for (const Column& c : columns_) text += at ? "," + c.name : fmt::format(",{0}(T),max|{0}|", c.name);
  for (const Measure& m : measures_)
    text += m.name.find(',') == std::string::npos ? "," + m.name : ",\"" + m.name + "\"";
  return text + ",reason,warning\n";
}

std::string SweepTable::rows(const SceneBlock& block, const BatchResult& result, const std::vector<Index>& places,
                             const HostThreads& threads) const {
  std::vector<std::string> parts(std::size_t((block.count + scenes_together - 1) / scenes_together));
  share(threads, Index(parts.size()), 1, [&](Index begin, Index end) {
    for (Index p = begin; p < end; ++p)
      for (Index i = p * scenes_together; i < std::min(block.count, (p + 1) * scenes_together); ++i)
        for (Index at = 0; at < std::max<Index>(1, Index(times_.size())); ++at)
          add_row(parts[std::size_t(p)], block, i, result, places[std::size_t(i)], at);
  });
  std::string all;
  for (const std::string& part : parts) all += part;
  return all;
}

void SweepTable::add_row(std::string& text, const SceneBlock& block, Index scene, const BatchResult& result,
                         Index place, Index at) const {
  const std::size_t i = std::size_t(scene);
  fmt::format_to(std::back_inserter(text), "{}", block.first + scene);
  for (Index c = 0; c < sweep_.values.cols(); ++c) add_number(text, sweep_.values(block.first + scene, c));
  if (!times_.empty()) add_number(text, times_[std::size_t(at)]);
  text += "," + block.status[i];
  add_number(text, place < 0 ? NAN : result.residual[place]);
  for (const Column& c : columns_) add_values(text, result, c, place, at);
  for (const Measure& m : measures_)
    add_number(text, place < 0 ? NAN : measured(m, result.t, values(result, m.column, place)));
  add_text(text, block.reason[i]);
  add_text(text, block.warning[i]);
  text += '\n';
}

// At one time, or at T with the largest size.
void SweepTable::add_values(std::string& text, const BatchResult& result, const Column& c, Index place,
                            Index at) const {
  const bool one_row = times_.empty();
  if (place < 0) {
    for (int k = 0; k < (one_row ? 2 : 1); ++k) add_number(text, NAN);
    return;
  }
  const Vector of_times = values(result, c, place);
  add_number(text, of_times[one_row ? of_times.size() - 1 : at]);
  if (one_row) add_number(text, of_times.cwiseAbs().maxCoeff<Eigen::PropagateNaN>());
}

Vector SweepTable::values(const BatchResult& result, const Column& c, Index place) const {
  const RowMatrix& all = c.kind == ColumnKind::y ? result.y : c.kind == ColumnKind::w ? result.w : result.x;
  const Index column =
      c.kind == ColumnKind::x ? std::find(states_.begin(), states_.end(), c.component) - states_.begin() : c.component;
  return result.of(all, place).col(column);
}

}  // namespace bromwich::app

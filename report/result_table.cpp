#include "report/result_table.hpp"

#include "core/base/error.hpp"
#include "core/result/slack.hpp"
#include "core/scene/component_names.hpp"
#include "files/line_reader.hpp"
#include "files/number_files.hpp"
#include "files/stored_result.hpp"
#include "files/words.hpp"
#include "report/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <functional>
#include <map>

namespace bromwich::report {

namespace {

using Name = std::string (*)(const Scene&, Index);

/// `numbers`: the components in the columns; null: all.
Quantity named(const std::string& symbol, RowMatrix values, const Scene& scene, Name name,
               const std::vector<std::string>& units, const std::vector<Index>* numbers = nullptr) {
  Quantity q{symbol, {}, {}, std::move(values)};
  for (Index k = 0; k < q.values.cols(); ++k) {
    const Index i = numbers ? (*numbers)[std::size_t(k)] : k;
    q.names.push_back(name(scene, i));
    q.units.push_back(std::size_t(i) < units.size() ? units[std::size_t(i)] : "");
  }
  return q;
}

void add(Quantity quantity, ResultTable& table) {
  if (!quantity.names.empty()) table.quantities.push_back(std::move(quantity));
}

// ---- CSV ----

struct Column {
  std::string name, unit;
  std::string symbol() const {
    const bool indexed =
        name.size() > 1 && std::all_of(name.begin() + 1, name.end(), [](unsigned char c) { return std::isdigit(c); });
    return indexed && (name[0] == 'y' || name[0] == 'w' || name[0] == 'x') ? name.substr(0, 1) : "";
  }
};

/// "i_L [A]": a name and its unit.
Column column(std::string_view cell) {
  const std::size_t open = cell.find('[');
  if (open == std::string_view::npos || cell.back() != ']') return {one_line(cell), ""};
  return {one_line(cell.substr(0, open)), one_line(cell.substr(open + 1, cell.size() - open - 2))};
}

double value(const LineReader& lines, std::string_view cell) {
  const bool missing = cell.empty() || cell == "nan" || cell == "NaN" || cell == "-nan";
  return missing ? std::nan("") : lines.number(cell);
}

std::vector<Column> read_header(LineReader& lines) {
  std::vector<Column> columns;
  if (lines.next())
    for (const std::string_view cell : lines.cells()) columns.push_back(column(cell));
  if (columns.empty() || columns.front().name != "t")
    throw Error(lines.place(), "found no header t,y0,y1,...", "give a file that 'bromwich solve --out' has written");
  return columns;
}

/// All rows, one after the other; a comment ends up in `remark`.
std::vector<double> read_rows(LineReader& lines, std::size_t columns, std::string& remark) {
  std::vector<double> values;
  double before = -INFINITY;
  while (lines.next()) {
    if (lines.blank()) continue;
    if (lines.line()[0] == '#') {
      remark = one_line(lines.line().substr(1));
      continue;
    }
    const auto cells = lines.cells();
    if (cells.size() != columns)
      throw Error(lines.place(), fmt::format("found {} values where the header has {}", cells.size(), columns),
                  "give rows of equal length");
    for (const std::string_view cell : cells) values.push_back(value(lines, cell));
    const double t = values[values.size() - columns];
    if (!(t >= before)) throw Error(lines.place(), "the times do not ascend", "give ascending times");
    before = t;
  }
  return values;
}

/// Whether columns were given names of their own: none is called y and a number.
bool renamed(const std::vector<Column>& columns, Index constraints) {
  return constraints > 0 && Index(columns.size()) > constraints &&
         std::none_of(columns.begin(), columns.end(), [](const Column& c) { return c.symbol() == "y"; });
}

ResultTable read_csv(const std::filesystem::path& path, const std::string& argument, Index constraints) {
  const std::string name = path.filename().string(), text = read_text({path.string(), path}, argument);
  LineReader lines(text, name);
  const std::vector<Column> columns = read_header(lines);
  ResultTable table;
  const std::vector<double> values = read_rows(lines, columns.size(), table.remark);
  const Index width = Index(columns.size()), rows = Index(values.size()) / width;
  const Eigen::Map<const RowMatrix> all(values.data(), rows, width);
  table.t = all.col(0);
  table.time_unit = columns.front().unit;
  const bool by_place = renamed(columns, constraints);
  const auto symbol_of = [&](Index i) -> std::string {
    return by_place ? (i <= constraints ? "y" : "x") : columns[std::size_t(i)].symbol();
  };
  for (const char* symbol : {"y", "w", "x", ""}) {
    Quantity q{symbol, {}, {}, {}};
    std::vector<Index> which;
    for (Index i = 1; i < width; ++i) {
      if (symbol_of(i) != symbol) continue;
      which.push_back(i);
      q.names.push_back(columns[std::size_t(i)].name);
      q.units.push_back(columns[std::size_t(i)].unit);
    }
    q.values = all(Eigen::all, which);
    add(std::move(q), table);
  }
  return table;
}

// ---- HDF5 and NPZ ----

/// The summary of the file; of a run that has not ended, or was saved from Python, what its facts say.
Json summary_of(const StoredResult& stored) {
  Json summary = Json::parse(stored.text("summary"), nullptr, false);
  if (summary.is_object()) return summary;
  summary = Json::object();
  for (const auto& [name, fact] : stored.facts)
    std::visit([&, &key = name](const auto& value) { summary[key] = value; }, fact);
  for (const char* key : {"parameters", "options"})  // JSON in a text
    if (const std::string text = stored.text(key); !text.empty()) summary[key] = Json::parse(text, nullptr, false);
  summary.erase("summary");
  summary.erase("seconds");  // a number here, an object there
  return summary;
}

Quantity stored(const std::string& symbol, const RowMatrix& values, const std::vector<std::string>& names,
                const std::string& unit) {
  Quantity q{symbol, names, {}, values};
  for (Index i = Index(names.size()); i < values.cols(); ++i) q.names.push_back(symbol + std::to_string(i));
  q.units.assign(q.names.size(), unit);
  return q;
}

/// Units that differ from column to column are in the summary alone.
void add_units(const Json& summary, const std::string& symbol, const std::vector<std::string>& all_names, Quantity& q) {
  const auto units = summary.find("units");
  if (units == summary.end() || !units->is_object() || !units->contains(symbol)) return;
  const Json& list = (*units)[symbol];
  for (std::size_t i = 0; i < q.units.size(); ++i) {
    const auto at = std::find(all_names.begin(), all_names.end(), q.names[i]);
    const std::size_t k = all_names.empty() ? i : std::size_t(at - all_names.begin());
    if (q.units[i].empty() && list.is_array() && k < list.size() && list[k].is_string())
      q.units[i] = list[k].get<std::string>();
  }
}

std::vector<std::string> names_in(const Json& summary, const std::string& symbol) {
  std::vector<std::string> names;
  if (const auto all = summary.find("names"); all != summary.end() && all->is_object() && all->contains(symbol))
    for (const Json& name : (*all)[symbol])
      if (name.is_string()) names.push_back(name.get<std::string>());
  return names;
}

ResultTable read_stored(const StoredResult& file) {
  ResultTable table;
  table.t = file.t;
  const Json summary = summary_of(file);
  if (!summary.empty()) table.summary = summary.dump(-1, ' ', false, Json::error_handler_t::replace);
  table.time_unit = file.t_unit.empty() ? text_at(summary, "units/t") : file.t_unit;
  std::vector<std::string> slack_names = names_in(summary, "w");
  const bool own_names = !file.constraint_names.empty() && file.constraint_names.front() != "y0";
  if (slack_names.empty() && own_names)
    for (const std::string& name : file.constraint_names) slack_names.push_back("w of " + name);
  Quantity y = stored("y", file.y, file.constraint_names, file.y_unit),
           w = stored("w", file.w, slack_names, file.w_unit), x = stored("x", file.x, file.state_names, file.x_unit);
  add_units(summary, "y", {}, y);
  add_units(summary, "w", {}, w);
  add_units(summary, "x", names_in(summary, "x"), x);
  Quantity others{"", {}, {}, RowMatrix(file.t.size(), Index(file.others.size()))};
  for (const TimeSeries& one : file.others) {
    others.values.col(Index(others.names.size())) = one.values.head(file.t.size());
    others.names.push_back(one.name);
    others.units.emplace_back();
  }
  for (Quantity* q : {&y, &w, &x, &others}) add(std::move(*q), table);
  return table;
}

ResultTable read_hdf5_table(const std::filesystem::path& path, const std::string& argument, Index /*constraints*/) {
  return read_stored(read_hdf5({argument, path}));
}

ResultTable read_npz_table(const std::filesystem::path& path, const std::string& argument, Index /*constraints*/) {
  return read_stored(read_npz({argument, path}));
}

/// What reads a file, by its extension.
using Reader = std::function<ResultTable(const std::filesystem::path&, const std::string& argument, Index constraints)>;
const std::map<std::string, Reader>& readers() {
  static const std::map<std::string, Reader> known{{".csv", read_csv},         {".h5", read_hdf5_table},
                                                   {".hdf5", read_hdf5_table}, {".nc", read_hdf5_table},
                                                   {".npz", read_npz_table},   {".vtkhdf", read_hdf5_table}};
  return known;
}

}  // namespace

const Quantity* ResultTable::find(const std::string& symbol) const {
  for (const Quantity& q : quantities)
    if (q.symbol == symbol) return &q;
  return nullptr;
}

ResultTable as_table(const Scene& scene, const Result& result) {
  ResultTable table;
  table.t = result.t;
  table.time_unit = scene.time_unit;
  add(named("y", result.y, scene, multiplier_name, scene.units.y), table);
  add(named("w", slack(scene, result), scene, slack_name, scene.units.w), table);
  add(named("x", result.x, scene, state_name, scene.units.x, &result.x_components), table);
  return table;
}

ResultTable read_result(const std::string& argument, const std::filesystem::path& path, Index constraints) {
  const auto reader = readers().find(path.extension().string());
  if (reader != readers().end()) return reader->second(path, argument, constraints);
  std::vector<std::string> known;
  for (const auto& [extension, read] : readers()) known.push_back(extension);
  throw Error(argument, fmt::format("found '{}'", one_line(path.string())),
              "give a file " + join(known) + " that 'bromwich solve --out' has written");
}

}  // namespace bromwich::report

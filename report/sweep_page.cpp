#include "report/sweep_page.hpp"

#include "core/base/error.hpp"
#include "report/charts.hpp"
#include "report/page_pieces.hpp"
#include "report/plain_page.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <vector>

namespace bromwich::report {

namespace {

using Cells = std::vector<std::string>;

StoredSweep read_rows(const std::string& argument, const std::filesystem::path& path) {
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  const Cells header = cells_of(line);
  const auto status = std::find(header.begin(), header.end(), "status") - header.begin();
  const auto end = std::find(header.begin(), header.end(), "reason") - header.begin();
  StoredSweep rows;
  rows.parameters.assign(header.begin() + 1, header.begin() + status);
  rows.columns.assign(header.begin() + status + 1, header.begin() + end);
  std::vector<Cells> all;
  while (std::getline(in, line))
    if (!line.empty()) all.push_back(cells_of(line));
  rows.swept.resize(Index(all.size()), status - 1);
  rows.values.resize(Index(all.size()), end - status - 1);
  for (std::size_t k = 0; k < all.size(); ++k) {
    if (all[k].size() != header.size())
      throw Error(
          argument,
          fmt::format("'{}' has {} cells in row {} and {} names", path.string(), all[k].size(), k, header.size()),
          "give a table that 'bromwich solve --out' has written");
    rows.status.push_back(all[k][std::size_t(status)]);
    for (Index c = 0; c < rows.swept.cols(); ++c) rows.swept(Index(k), c) = number_of(all[k][std::size_t(c + 1)]);
    for (Index c = 0; c < rows.values.cols(); ++c)
      rows.values(Index(k), c) = number_of(all[k][std::size_t(status + 1 + c)]);
  }
  return rows;
}

std::vector<double> different(const Eigen::Ref<const Vector>& column) {
  std::vector<double> found(column.begin(), column.end());
  std::sort(found.begin(), found.end());
  found.erase(std::unique(found.begin(), found.end()), found.end());
  return found;
}

/// The ends of cells around the values, which a map shows from one end to the next.
Vector ends_of(const std::vector<double>& values) {
  const std::size_t n = values.size();
  Vector ends(Index(n) + 1);
  for (std::size_t k = 1; k < n; ++k) ends[Index(k)] = (values[k - 1] + values[k]) / 2;
  ends[0] = values[0] - (ends[1] - values[0]);
  ends[Index(n)] = values[n - 1] + (values[n - 1] - ends[Index(n) - 1]);
  return ends;
}

/// Over two parameters whose values are all combined.
std::string map_of(const StoredSweep& rows, Index a, Index b, Index column) {
  const std::vector<double> across = different(rows.swept.col(a)), up = different(rows.swept.col(b));
  RowMatrix values = RowMatrix::Constant(Index(across.size()) + 1, Index(up.size()), NAN);
  const auto place = [](const std::vector<double>& all, double value) {
    return Index(std::lower_bound(all.begin(), all.end(), value) - all.begin());
  };
  for (Index k = 0; k < rows.swept.rows(); ++k)
    values(place(across, rows.swept(k, a)), place(up, rows.swept(k, b))) = rows.values(k, column);
  values.bottomRows(1) = values.row(Index(across.size()) - 1);
  const std::string &x = rows.parameters[std::size_t(a)], &y = rows.parameters[std::size_t(b)];
  HeatMap map{rows.columns[std::size_t(column)] + " over " + x + " and " + y,
              x,
              y,
              rows.columns[std::size_t(column)],
              ends_of(across),
              std::move(values)};
  map.rows = up;
  return heat_map(map);
}

std::string curve_of(const StoredSweep& rows, Index parameter, Index column) {
  std::map<double, double> sorted;
  for (Index k = 0; k < rows.swept.rows(); ++k) sorted[rows.swept(k, parameter)] = rows.values(k, column);
  Vector x(Index(sorted.size())), y(Index(sorted.size()));
  Index i = 0;
  for (const auto& [at, value] : sorted) x[i] = at, y[i++] = value;
  const std::string &name = rows.columns[std::size_t(column)], &over = rows.parameters[std::size_t(parameter)];
  LineChart chart{name + " over " + over, {over}, {name}, {}, {}};
  chart.lines.push_back({name, x, y, false, sorted.size() <= 50});
  return line_chart(chart);
}

std::string pictures(const StoredSweep& rows) {
  std::vector<Index> varied;
  for (Index c = 0; c < rows.swept.cols(); ++c)
    if (different(rows.swept.col(c)).size() > 1) varied.push_back(c);
  const bool product = varied.size() == 2 && Index(different(rows.swept.col(varied[0])).size() *
                                                   different(rows.swept.col(varied[1])).size()) == rows.swept.rows();
  std::string html;
  for (Index column = 0; column < rows.values.cols(); ++column) {
    const std::string& name = rows.columns[std::size_t(column)];
    if (name == "residual" || !rows.values.col(column).array().isFinite().any()) continue;
    if (product) {
      html += figure(map_of(rows, varied[1], varied[0], column), name + ", for each scene.");
      continue;
    }
    for (const Index parameter : varied)
      html += figure(curve_of(rows, parameter, column),
                     varied.size() == 1 ? name + ", for each scene." : name + ": the last scene with each value.");
  }
  return html;
}

bool is_table(const std::filesystem::path& path) {
  std::ifstream in(path);
  std::string line;
  return std::getline(in, line) && line.starts_with("scene,") && line.find(",status,residual") != std::string::npos &&
         line.find(",t,status") == std::string::npos;
}

}  // namespace

std::optional<StoredSweep> read_sweep_table(const std::string& argument, const std::filesystem::path& path) {
  if (path.extension() == ".csv" && is_table(path)) return read_rows(argument, path);
  if (path.extension() == ".h5") return read_sweep_hdf5({argument, path});
  return std::nullopt;
}

std::string sweep_page(const StoredSweep& rows, const std::string& name, const std::string& version) {
  const auto solved = std::count(rows.status.begin(), rows.status.end(), "solved");
  const std::string over = fmt::format("{}", fmt::join(rows.parameters, ", "));
  return plain_page(name,
                    fmt::format("<p>{} of {} scenes solved, over {}.</p>\n{}", solved, rows.status.size(),
                                escaped(over), pictures(rows)),
                    version);
}

}  // namespace bromwich::report

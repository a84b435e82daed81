#include "report/response_page.hpp"

#include "core/base/error.hpp"
#include "report/charts.hpp"
#include "report/page_pieces.hpp"
#include "report/plain_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>

namespace bromwich::report {

namespace {

std::string quoted(const std::string& cell) { return cell.find(',') == std::string::npos ? cell : '"' + cell + '"'; }

/// NAME of "abs(NAME)".
std::string inner_name(const std::string& cell) { return cell.substr(4, cell.size() - 5); }

/// Of some of the curves, in dB or in degrees.
std::string chart(const ResponseCurves& r, Index first, Index count, bool sizes) {
  const char* const what = sizes ? "size [dB]" : "phase [degrees]";
  LineChart drawn{std::string(what) + " over frequency", {"frequency [Hz]", true}, {what}, {}, {}};
  for (Index k = first; k < first + count; ++k) {
    const Vector y = sizes ? Vector(20 * r.sizes.col(k).array().log10()) : Vector(r.phases.col(k));
    const std::size_t at = std::size_t(k);
    drawn.lines.push_back({with_unit(r.names[at], r.units.empty() ? "" : r.units[at]), r.frequencies, y});
  }
  return line_chart(drawn);
}

}  // namespace

std::string response_table(const ResponseCurves& r) {
  std::string text = "frequency";
  for (const std::string& name : r.names)
    text += "," + quoted("abs(" + name + ")") + "," + quoted("phase(" + name + ")");
  text += "\n";
  for (Index i = 0; i < r.frequencies.size(); ++i) {
    fmt::format_to(std::back_inserter(text), "{}", r.frequencies[i]);
    for (Index k = 0; k < r.sizes.cols(); ++k)
      fmt::format_to(std::back_inserter(text), ",{},{}", r.sizes(i, k), r.phases(i, k));
    text += "\n";
  }
  return text;
}

std::optional<ResponseCurves> read_response_table(const std::string& argument, const std::filesystem::path& path) {
  std::ifstream in(path);
  std::string line;
  if (path.extension() != ".csv" || !std::getline(in, line) || !line.starts_with("frequency,")) return std::nullopt;
  const std::vector<std::string> header = cells_of(line);
  ResponseCurves r;
  for (std::size_t k = 1; k + 1 < header.size(); k += 2) {
    if (!header[k].starts_with("abs(") || !header[k + 1].starts_with("phase(")) return std::nullopt;
    r.names.push_back(inner_name(header[k]));
  }
  std::vector<std::vector<std::string>> rows;
  while (std::getline(in, line))
    if (!line.empty()) rows.push_back(cells_of(line));
  const Index count = Index(r.names.size());
  r.frequencies.resize(Index(rows.size()));
  r.sizes.resize(Index(rows.size()), count);
  r.phases.resize(Index(rows.size()), count);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].size() != header.size())
      throw Error(
          argument,
          fmt::format("'{}' has {} cells in row {} and {} names", path.string(), rows[i].size(), i, header.size()),
          "give a table that 'bromwich response --out' has written");
    r.frequencies[Index(i)] = number_of(rows[i][0]);
    for (Index k = 0; k < count; ++k) {
      r.sizes(Index(i), k) = number_of(rows[i][std::size_t(2 * k + 1)]);
      r.phases(Index(i), k) = number_of(rows[i][std::size_t(2 * k + 2)]);
    }
  }
  return r;
}

std::string response_page(const ResponseCurves& r, const std::string& name, const std::string& version) {
  Table facts;
  for (const auto& [label, words] : r.facts) facts.row(label, words);
  std::string body = facts.end();
  const Index all = Index(r.names.size()), most = Index(most_lines);
  for (Index first = 0; first < all; first += most) {
    const Index count = std::min(most, all - first);
    body += figure(chart(r, first, count, true) + chart(r, first, count, false),
                   "Size and phase about the periodic state, over the frequency of a small sine.");
  }
  return plain_page(name, body, version);
}

}  // namespace bromwich::report

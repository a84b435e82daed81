// Measured values for `bromwich fit`, from CSV.

#include "app/fit.hpp"
#include "app/measures.hpp"
#include "app/text.hpp"
#include "circuits/probe.hpp"
#include "core/base/error.hpp"
#include "files/number_files.hpp"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <sstream>

namespace bromwich::app {

namespace {

std::vector<std::string> fields(const std::string& line) {
  std::vector<std::string> words = split_outside(line);
  for (std::string& word : words) {
    const auto first = word.find_first_not_of(" \t\r\""), last = word.find_last_not_of(" \t\r\"");
    word = first == std::string::npos ? "" : word.substr(first, last - first + 1);
  }
  return words;
}

double number(const std::string& word, const std::string& place) {
  if (word.empty() || word == "nan" || word == "NaN" || word == "NA") return NAN;
  std::size_t used = 0;
  double value = NAN;
  try {
    value = std::stod(word, &used);
  } catch (const std::exception&) {
    used = 0;
  }
  if (used != word.size() || !std::isfinite(value))
    throw Error(place, fmt::format("found '{}'", one_line(word)), "give finite numbers; an empty field is no datum");
  return value;
}

}  // namespace

namespace {

Column column_named(const std::string& word, const FitModel& model, const std::string& place) {
  if (model.circuit) {
    const Probe known(*model.circuit, word, place);
    return {ColumnKind::x, 0, known.text()};
  }
  const std::vector<Column> columns = parse_columns(word, model.scene);
  if (columns.size() != 1 || word == "y" || word == "x" || word == "w")
    throw Error(place, fmt::format("found the column '{}'", one_line(word)), "name one component: y0, x1, w0");
  return columns.front();
}

}  // namespace

FitData read_fit_data(const std::string& argument, const std::string& file, const FitModel& model) {
  std::error_code failure;
  if (!std::filesystem::exists(file, failure))
    throw Error(argument, fmt::format("the file '{}' does not exist", one_line(file)), "give the path of a CSV file");
  std::stringstream in(read_text({file, file}, argument));
  FitData data;
  std::vector<std::vector<double>> rows;
  long at = 0;
  for (std::string line; std::getline(in, line);) {
    ++at;
    if (line.find_first_not_of(" \t\r") == std::string::npos || line.front() == '#') continue;
    const std::vector<std::string> words = fields(line);
    const std::string place = fmt::format("{}, line {}", file, at);
    if (data.columns.empty()) {
      if (words.size() < 2 || words.front() != "t")
        throw Error(
            place, fmt::format("found '{}'", one_line(line)),
            model.circuit ? "begin with a header such as t,V(out),I(L1)" : "begin with a header such as t,x0,y0");
      for (std::size_t k = 1; k < words.size(); ++k) data.columns.push_back(column_named(words[k], model, place));
      continue;
    }
    if (words.size() != data.columns.size() + 1)
      throw Error(place, fmt::format("has {} fields", words.size()),
                  fmt::format("give {}, as in the header", data.columns.size() + 1));
    const double t = number(words.front(), place);
    if (!(t >= 0 && t <= model.scene.T))
      throw Error(place, fmt::format("found t = {}", words.front()),
                  fmt::format("give times from 0 to {}", model.scene.T));
    data.t.push_back(t);
    rows.emplace_back();
    for (std::size_t k = 1; k < words.size(); ++k) rows.back().push_back(number(words[k], place));
  }
  data.values.resize(Index(rows.size()), Index(data.columns.size()));
  for (std::size_t j = 0; j < rows.size(); ++j)
    for (std::size_t k = 0; k < rows[j].size(); ++k) data.values(Index(j), Index(k)) = rows[j][k];
  return data;
}

}  // namespace bromwich::app

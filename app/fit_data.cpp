// Measured values for `bromwich fit`, from CSV.

#include "app/fit.hpp"
#include "app/text.hpp"
#include "core/base/error.hpp"
#include "files/number_files.hpp"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <sstream>

namespace bromwich::app {

namespace {

std::vector<std::string> fields(const std::string& line) {
  std::vector<std::string> words;
  std::stringstream in(line);
  for (std::string word; std::getline(in, word, ',');) {
    const auto first = word.find_first_not_of(" \t\r\""), last = word.find_last_not_of(" \t\r\"");
    words.push_back(first == std::string::npos ? "" : word.substr(first, last - first + 1));
  }
  if (!line.empty() && line.back() == ',') words.emplace_back();
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

FitData read_fit_data(const std::string& argument, const std::string& file, const Scene& scene) {
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
        throw Error(place, fmt::format("found '{}'", one_line(line)), "begin with a header such as t,x0,y0");
      for (std::size_t k = 1; k < words.size(); ++k) {
        const std::vector<Column> columns = parse_columns(words[k], scene);
        if (columns.size() != 1 || words[k] == "y" || words[k] == "x" || words[k] == "w")
          throw Error(place, fmt::format("found the column '{}'", one_line(words[k])),
                      "name one component: y0, x1, w0");
        data.columns.push_back(columns.front());
      }
      continue;
    }
    if (words.size() != data.columns.size() + 1)
      throw Error(place, fmt::format("has {} fields", words.size()),
                  fmt::format("give {}, as in the header", data.columns.size() + 1));
    const double t = number(words.front(), place);
    if (!(t >= 0 && t <= scene.T))
      throw Error(place, fmt::format("found t = {}", words.front()), fmt::format("give times from 0 to {}", scene.T));
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

#include "app/measures.hpp"

#include "app/text.hpp"
#include "core/base/error.hpp"
#include "files/scene_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace bromwich::app {

namespace {

constexpr std::pair<const char*, MeasureKind> kinds[] = {{"mean", MeasureKind::mean},
                                                         {"rms", MeasureKind::rms},
                                                         {"min", MeasureKind::min},
                                                         {"max", MeasureKind::max},
                                                         {"ripple", MeasureKind::ripple}};

Measure parse_measure(const std::string& word, const Scene& scene, const ParameterValues& parameters) {
  const std::size_t open = word.find('(');
  const std::string what = word.substr(0, open);
  std::vector<std::string> names;
  for (const auto& [name, kind] : kinds) names.emplace_back(name);
  const auto known = std::find(names.begin(), names.end(), what);
  if (known == names.end() || word.back() != ')')
    throw Error("--columns", fmt::format("found '{}'", word) + suggestion(what, names),
                "write mean(v), rms(v), min(v), max(v) or ripple(v), or ripple(v, from, to)");
  const auto arguments = split_outside(word.substr(open + 1, word.size() - open - 2));
  const std::vector<Column> columns = parse_columns(arguments[0], scene);
  if (columns.size() != 1 || (arguments.size() != 1 && arguments.size() != 3))
    throw Error("--columns", fmt::format("found '{}'", word),
                "give one component, and no times or two: ripple(v, from, to)");
  Measure measure{kinds[known - names.begin()].second, columns[0], {}, {}, word};
  if (arguments.size() == 1) return measure;
  ParameterValues known_names = parameters;
  known_names.emplace("T", scene.T);
  measure.from = constant_expression(arguments[1], known_names, "--columns");
  measure.to = constant_expression(arguments[2], known_names, "--columns");
  if (!(*measure.from >= 0 && *measure.from < *measure.to && *measure.to <= scene.T * (1 + 1e-12)))
    throw Error("--columns", fmt::format("found the span {} to {}", *measure.from, *measure.to),
                fmt::format("give ascending times from 0 to T = {}", scene.T));
  return measure;
}

}  // namespace

std::vector<std::string> split_outside(const std::string& text) {
  std::vector<std::string> words{""};
  int depth = 0;
  for (const char c : text) {
    depth += int(c == '(') - int(c == ')');
    if (c == ',' && depth == 0)
      words.emplace_back();
    else if (c != ' ')
      words.back() += c;
  }
  return words;
}

std::vector<Measure> parse_measures(const std::string& words, const Scene& scene, const ParameterValues& parameters,
                                    std::vector<Column>& columns) {
  std::vector<Measure> measures;
  std::string plain;
  for (const std::string& word : split_outside(words)) {
    if (word.find('(') == std::string::npos)
      plain += (plain.empty() ? "" : ",") + word;
    else
      measures.push_back(parse_measure(word, scene, parameters));
  }
  if (!plain.empty() || measures.empty()) columns = parse_columns(plain, scene);
  return measures;
}

double measured(const Measure& measure, const Vector& t, const Vector& values) {
  const Index last = t.size() - 1;
  const double from = measure.from.value_or(t[0]), to = std::min(measure.to.value_or(t[last]), t[last]);
  double integral = 0, square = 0, least = INFINITY, most = -INFINITY;
  for (Index j = 0; j < last; ++j) {
    const double begin = std::max(t[j], from), end = std::min(t[j + 1], to), h = end - begin;
    if (!(h > 0)) continue;
    const auto at = [&](double time) {
      const double share = (time - t[j]) / (t[j + 1] - t[j]);
      return (1 - share) * values[j] + share * values[j + 1];
    };
    const double a = at(begin), b = at(end);
    if (!std::isfinite(a) || !std::isfinite(b)) return std::numeric_limits<double>::quiet_NaN();
    integral += h * (a + b) / 2;
    square += h * (a * a + a * b + b * b) / 3;
    least = std::min({least, a, b}), most = std::max({most, a, b});
  }
  switch (measure.kind) {
    case MeasureKind::mean:
      return integral / (to - from);
    case MeasureKind::rms:
      return std::sqrt(square / (to - from));
    case MeasureKind::min:
      return least;
    case MeasureKind::max:
      return most;
    case MeasureKind::ripple:
      break;
  }
  return most - least;
}

}  // namespace bromwich::app

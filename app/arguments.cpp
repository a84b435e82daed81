#include "app/arguments.hpp"

#include "app/scene_choice.hpp"
#include "app/text.hpp"
#include "circuits/circuit.hpp"
#include "circuits/values.hpp"
#include "core/base/error.hpp"
#include "files/scene_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <tuple>

namespace bromwich::app {

namespace {

std::string found(const std::string& word) { return fmt::format("found '{}'", word); }

long long integer_within(const char* argument, const std::string& word, long long limit) {
  const auto value = parse_count(word);
  if (!value || *value < 1 || *value > limit)
    throw Error(argument, found(word), fmt::format("give an integer from 1 to {}", limit));
  return *value;
}

double fraction(const char* argument, const std::string& word, const char* example) {
  const auto value = parse_double(word);
  if (!value || *value <= 0 || *value >= 1)
    throw Error(argument, found(word), fmt::format("give a number between 0 and 1, such as {}", example));
  return *value;
}

double positive(const std::string& argument, const std::string& word) {
  const auto value = parse_double(word);
  if (!value || !(*value > 0) || !std::isfinite(*value)) throw Error(argument, found(word), "give a positive number");
  return *value;
}

bool contains(const std::vector<std::string>& words, const std::string& word) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

}  // namespace

Index parse_steps(const std::string& word, long long limit) { return Index(integer_within("--steps", word, limit)); }

int parse_threads(const std::string& word) { return int(integer_within("--threads", word, max_threads)); }

double parse_seconds(const std::string& argument, const std::string& word) { return positive(argument, word); }

void parse_error_control(const SolveArguments& a, Options& options, const Scene& scene, bool of_states) {
  // Method goal has an absolute tolerance, of its quantity.
  const bool absolute = options.method == Method::goal;
  for (const auto& [argument, word, value] : {std::tuple("--tol", &a.tolerance, &options.tolerance),
                                              {"--tol-x", &a.tolerance_x, &options.tolerance_x},
                                              {"--tol-y", &a.tolerance_y, &options.tolerance_y}})
    if (!word->empty()) *value = absolute ? positive(argument, *word) : fraction(argument, *word, "1e-4");
  if (!a.absolute_tolerance.empty()) options.absolute_tolerance = positive("--atol", a.absolute_tolerance);
  if (!a.max_steps.empty()) options.max_steps = Index(integer_within("--max-steps", a.max_steps, max_steps));
  if (!a.max_seconds.empty()) options.max_seconds = positive("--max-seconds", a.max_seconds);
  if (!controls_error(options)) {
    options = with_defaults(options, scene);
    if (of_states) std::swap(options.tolerance, options.tolerance_x);
  }
  if (!controls_error(options) && !(a.max_steps.empty() && a.max_seconds.empty()))
    throw Error(a.max_steps.empty() ? "--max-seconds" : "--max-steps", "is given without a tolerance", "add --tol EPS");
}

Index parse_nodes(const std::string& word, Method method) {
  if (method != Method::contour_literal)
    throw Error("--nodes", fmt::format("is given with method {}", to_string(method)), "add --method contour-literal");
  const auto value = parse_count(word);
  if (!value || *value < 2 || *value > 400) throw Error("--nodes", found(word), "give an integer from 2 to 400");
  return Index(*value);
}

double parse_iteration_tolerance(const std::string& word) { return fraction("--iteration-tol", word, "1e-12"); }

std::vector<std::string> method_names() {
  std::vector<std::string> names;
  // The enumerators count up from 0; to_string has no text for other numbers.
  for (int i = 0; to_string(Method(i)) != std::string("unknown"); ++i) names.emplace_back(to_string(Method(i)));
  return names;
}

Method parse_method(const std::string& word) {
  static const std::vector<std::string> available = method_names();
  if (!contains(available, word))
    throw Error("--method", found(word) + suggestion(word, available), "use one of " + join(available));
  return method_from_string(word);
}

void parse_states(const std::string& argument, const std::string& word, const Scene& scene, Options& options) {
  StateChoice choice = parse_state_choice(argument, word, scene);
  options.states = choice.selection;
  options.components = std::move(choice.components);
}

std::vector<double> parse_times(const std::string& word, double T) {
  constexpr double rounding = 1e-9;  // T = 2 pi may be written as 6.2831853072
  std::vector<double> times;
  for (const std::string& item : split_list(word)) {
    const auto value = parse_double(item);
    if (!value || *value < 0 || *value > T * (1 + rounding))
      throw Error("--at", item == word ? found(word) : fmt::format("found '{}' in '{}'", item, word),
                  fmt::format("give times from 0 to T = {}, such as 0.1,0.25", T));
    times.push_back(std::min(*value, T));
  }
  return times;
}

namespace {

/// A number, of netlists also with a suffix such as 10u, or an expression of `names`, the parameters with the settings
/// before it.
double setting(const std::string& key, const std::string& text, bool of_netlist,
               const std::function<ParameterValues()>& names) {
  if (const auto number = parse_double(text)) return *number;
  if (const auto number = of_netlist ? circuits::spice_number(text) : std::nullopt; number && std::isfinite(*number))
    return *number;
  const std::string found = fmt::format("found '{}' as the value of {}", text, key);
  for (const char* word : {"", "nan", "inf", "-inf", "infinity"})
    if (text == word) throw Error("--set", found, "give a finite number");
  try {
    return constant_expression(text, names(), "--set");
  } catch (const Error& error) {
    throw Error("--set", found + ": " + error.found(),
                "give a finite number, or an expression of pi, of settings before it and of parameters of the scene");
  }
}

/// "R = 500" in quotes of the shell.
std::string without_spaces(const std::string& text) {
  const std::size_t first = text.find_first_not_of(' ');
  return first == std::string::npos ? "" : text.substr(first, text.find_last_not_of(' ') - first + 1);
}

}  // namespace

ParameterValues parse_settings(const std::vector<std::string>& words, const std::string& scene) {
  ParameterValues values;
  for (const std::string& word : words) {
    const std::size_t equals = word.find('=');
    if (equals == std::string::npos || equals == 0)
      throw Error("--set", found(word), "write key=value, such as --set T=2");
    const std::string key = without_spaces(word.substr(0, equals)), text = without_spaces(word.substr(equals + 1));
    const double value = setting(key, text, is_netlist(scene), [&] {
      ParameterValues names = values;
      if (!scene.empty()) names.merge(known_parameters(scene, values));
      return names;
    });
    if (!values.emplace(key, value).second)
      throw Error("--set", fmt::format("{} is given twice", key), "set every parameter once");
  }
  return values;
}

Words split_words(const std::vector<std::string>& words, const std::vector<std::string>& settings) {
  Words split{{}, settings};
  for (const std::string& word : words) {
    if (word.find('=') == std::string::npos) {
      split.names.push_back(word);
      continue;
    }
    if (settings.empty()) throw Error("SCENE", found(word), fmt::format("to set a parameter write --set {}", word));
    split.settings.push_back(word);
  }
  return split;
}

std::string scene_name(const Words& words) {
  if (words.names.empty()) throw Error("SCENE", "found none", "name a scene; 'bromwich scenes' lists them");
  if (words.names.size() > 1)
    throw Error("SCENE", "found " + join(words.names), "name one scene; options start with --");
  return words.names.front();
}

}  // namespace bromwich::app

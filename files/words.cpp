#include "files/words.hpp"

#include "core/base/error.hpp"
#include "core/scene/component_names.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <numeric>
#include <utility>

namespace bromwich {

namespace {

bool same_letter(char a, char b) {
  return std::tolower(static_cast<unsigned char>(a)) == std::tolower(static_cast<unsigned char>(b));
}

/// Levenshtein distance: insertions, deletions and replacements of one character, ignoring case.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = diagonal + (same_letter(a[i - 1], b[j - 1]) ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({replaced, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row[b.size()];
}

/// Words of other programs, and what they are called here.
constexpr auto synonyms = std::to_array<std::pair<std::string_view, std::string_view>>({
    {"automatic", "auto"},
    {"default", "auto"},
    {"gpu", "cuda"},
    {"nvidia", "cuda"},
    {"device", "cuda"},
    {"host", "cpu"},
    {"radau", "march"},
    {"marching", "march"},
    {"timestepping", "march"},
    {"implicit", "euler"},
    {"implicit-euler", "euler"},
    {"backward-euler", "euler"},
    {"mgrit", "multigrid"},
    {"arcsin", "asin"},
    {"arccos", "acos"},
    {"arctan", "atan"},
    {"arctan2", "atan2"},
    {"fabs", "abs"},
    {"power", "pow"},
    {"sgn", "sign"},
    {"signum", "sign"},
    {"step", "heaviside"},
    {"theta", "heaviside"},
    {"fmod", "mod"},
    {"pwm", "pulse"},
    {"square", "pulse"},
    {"interp", "pwl"},
    {"eye", "identity"},
    {"zeros", "zero"},
    {"tridiagonal", "tridiag"},
    {"constants", "parameters"},
    {"params", "parameters"},
    {"lcp", "complementarity"},
    {"labels", "names"},
    {"tol", "tolerance"},
    {"--tolerance", "--tol"},
    {"--eps", "--tol"},
    {"--rtol", "--tol"},
    {"--abstol", "--atol"},
    {"--dt", "--steps"},
    {"--device", "--backend"},
    {"--gpu", "--backend"},
    {"--solver", "--method"},
    {"--output", "--out"},
    {"-o", "--out"},
    {"--plot", "--report"},
    {"--html", "--report"},
    {"--param", "--set"},
    {"--parameter", "--set"},
    {"-v", "--log-level"},
    {"--verbose", "--log-level"},
    {"help", "--help"},
    {"version", "--version"},
    {"list", "scenes"},
    {"run", "solve"},
    {"sweep", "solve"},
    {"report", "plot"},
    {"validate", "check"},
    {"implicit_euler", "euler"},
    {"backward_euler", "euler"},
    {"t_end", "T"},
    {"tend", "T"},
    {"end", "T"},
    {"tf", "T"},
    {"t_final", "T"},
    {"t_max", "T"},
    {"tmax", "T"},
    {"dt", "steps"},
    {"step_size", "steps"},
    {"nsteps", "steps"},
    {"n_steps", "steps"},
    {"rtol", "tolerance"},
    {"c", "N"},  // of Siconos
    {"d", "M"},
    {"mass", "E"},
    {"initial", "x0"},
});

template <class Number>
std::optional<Number> parse(std::string_view word) {
  if (word.size() > 1 && word[0] == '+' && word[1] != '-') word.remove_prefix(1);
  Number value{};
  const char* end = word.data() + word.size();
  const auto [stop, failure] = std::from_chars(word.data(), end, value);
  if (failure != std::errc{} || stop != end) return std::nullopt;
  return value;
}

}  // namespace

std::string join(const std::vector<std::string>& words) { return fmt::format("{}", fmt::join(words, ", ")); }

std::optional<std::string> nearest(const std::string& name, const std::vector<std::string>& candidates) {
  std::optional<std::string> best;
  std::size_t best_distance = std::max<std::size_t>(2, name.size() / 3) + 1;
  constexpr std::size_t letters_of_beginning = 4;
  for (const std::string& candidate : candidates) {
    if (name.size() >= letters_of_beginning && candidate.starts_with(name)) return candidate;
    const std::size_t distance = edit_distance(name, candidate);
    // Replacing every letter turns any short name into any other, which is not a useful suggestion.
    if (distance >= best_distance || distance >= std::min(candidate.size(), name.size())) continue;
    best = candidate;
    best_distance = distance;
  }
  return best;
}

std::string suggestion(const std::string& name, const std::vector<std::string>& candidates) {
  std::string lower = name;
  std::transform(lower.begin(), lower.end(), lower.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  auto guess = nearest(name, candidates);
  for (const auto& [other, ours] : synonyms)
    if (lower == other && std::find(candidates.begin(), candidates.end(), ours) != candidates.end()) guess = ours;
  return guess ? fmt::format(" (did you mean '{}'?)", *guess) : "";
}

std::string one_line(std::string_view text) {
  std::string line;
  for (const char c : text) {
    const bool blank = static_cast<unsigned char>(c) <= ' ' || c == '\x7f';
    if (!blank)
      line += c;
    else if (!line.empty() && line.back() != ' ')
      line += ' ';
  }
  while (!line.empty() && line.back() == ' ') line.pop_back();
  return line;
}

std::optional<double> parse_double(std::string_view word) {
  const auto value = parse<double>(word);
  return value && std::isfinite(*value) ? value : std::nullopt;
}

std::optional<long long> parse_integer(std::string_view word) { return parse<long long>(word); }

std::optional<long long> parse_count(std::string_view word) {
  constexpr double largest = 9007199254740992.0;  // above, not every whole number is a double
  if (const auto whole = parse_integer(word)) return whole;
  const auto value = parse_double(word);
  if (!value || *value != std::floor(*value) || std::abs(*value) > largest) return std::nullopt;
  return static_cast<long long>(*value);
}

std::vector<std::string> split_list(const std::string& list) {
  std::vector<std::string> words;
  for (std::size_t begin = 0; begin <= list.size();) {
    const std::size_t end = std::min(list.find(',', begin), list.size());
    words.push_back(list.substr(begin, end - begin));
    begin = end + 1;
  }
  return words;
}

StateChoice parse_state_choice(const std::string& argument, const std::string& word, const Scene& scene) {
  StateChoice choice;
  if (word == "none") return choice;
  choice.selection = word == "all" ? StateSelection::all : StateSelection::list;
  if (word == "all") return choice;

  const Index states = scene.states();
  std::vector<std::string> names = scene.names.x;
  const std::string remedy = fmt::format("give all, none, or different components from 0 to {} separated by commas{}",
                                         states - 1, names.empty() ? "" : ", or names: " + join(names));
  if (names.empty()) names = {"all", "none"};
  for (const std::string& item : split_list(word)) {
    const auto number = parse_integer(item);
    const Index component = number ? Index(*number) : find_state(scene, item);
    if (component < 0 || component >= states)
      throw Error(argument,
                  (item == word ? fmt::format("found '{}'", word) : fmt::format("found '{}' in '{}'", item, word)) +
                      (number ? "" : suggestion(item, names)),
                  remedy);
    choice.components.push_back(component);
  }
  auto sorted = choice.components;
  std::sort(sorted.begin(), sorted.end());
  const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
  if (twice != sorted.end()) throw Error(argument, fmt::format("component {} is given twice", *twice), remedy);
  return choice;
}

}  // namespace bromwich

#include "files/condition.hpp"

#include "core/base/error.hpp"
#include "files/names.hpp"
#include "files/state_functions.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace bromwich {

namespace {

constexpr const char* example = "write one comparison, such as \"x0 > 1.1\" or \"2*x0 - y1 < sin(t)\"";

/// left > right, or the other way.
struct Sides {
  std::string larger, smaller;
};

std::optional<Sides> sides_of(const std::string& text) {
  int depth = 0;
  std::optional<std::size_t> at;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '(') ++depth;
    if (c == ')') --depth;
    if (depth > 0) continue;
    if (c == '&' || c == '|' || c == '?' || c == '!' || (c == '=' && !(at && *at + 1 == i))) return std::nullopt;
    if (c != '<' && c != '>') continue;
    if (at) return std::nullopt;
    at = i;
  }
  if (!at) return std::nullopt;
  const std::size_t behind = *at + (text[*at + 1] == '=' ? 2 : 1);
  Sides sides{text.substr(0, *at), text.substr(behind)};
  if (text[*at] == '<') std::swap(sides.larger, sides.smaller);
  return sides;
}

/// A number that is affine in variables.
struct Affine {
  double value = 0;
  std::map<std::size_t, double> by = {};
};

/// A domain for `execute` at one time. What is not affine has no value.
struct AffineNumbers {
  double t;
  bool decided_by_variables = false;

  static Affine constant(double value) { return {value}; }
  Affine time() const { return {t}; }
  static Affine variable(std::size_t number) { return {0, {{number, 1}}}; }
  bool zero(const Affine& a) {
    decided_by_variables = decided_by_variables || !a.by.empty();
    return a.value == 0;
  }
  static Affine combined(const Affine& a, double of_a, const Affine& b, double of_b) {
    Affine sum{of_a * a.value + of_b * b.value};
    for (const auto& [k, slope] : a.by) sum.by[k] += of_a * slope;
    for (const auto& [k, slope] : b.by) sum.by[k] += of_b * slope;
    return sum;
  }
  static std::optional<Affine> apply(Operation o, const Affine& a, const Affine& b) {
    if (o == Operation::add) return combined(a, 1, b, 1);
    if (o == Operation::subtract) return combined(a, 1, b, -1);
    if (o == Operation::negative) return combined(a, -1, {}, 0);
    if (o == Operation::multiply && a.by.empty()) return combined(b, a.value, {}, 0);
    if (o == Operation::multiply && b.by.empty()) return combined(a, b.value, {}, 0);
    if (o == Operation::divide && b.by.empty()) return combined(a, 1 / b.value, {}, 0);
    if (!a.by.empty() || (takes_two(o) && !b.by.empty())) return std::nullopt;
    return Affine{takes_two(o) ? bromwich::apply(o, a.value, b.value) : bromwich::apply(o, a.value)};
  }
};

using SlopesOfText = std::map<std::size_t, double>;

bool agree(const SlopesOfText& a, const SlopesOfText& b) {
  constexpr double same = 1e-12;
  return std::all_of(a.begin(), a.end(), [&](const auto& one) {
    const auto other = b.find(one.first);
    return std::abs(one.second - (other == b.end() ? 0 : other->second)) <= same * std::abs(one.second);
  });
}

/// Nothing where the text is not affine with slopes that are the same at all times.
std::optional<SlopesOfText> slopes_of(const Formula& formula, double T) {
  constexpr int looks = 16;
  constexpr double golden = 0.6180339887498949;
  std::optional<SlopesOfText> found;
  std::vector<Affine> stack;
  for (int k = 0; k < looks; ++k) {
    AffineNumbers numbers{T * (k * golden - std::floor(k * golden))};
    const std::optional<Affine> value = execute(formula, numbers, stack);
    if (!value || numbers.decided_by_variables) return std::nullopt;
    if (found && !(agree(*found, value->by) && agree(value->by, *found))) return std::nullopt;
    found = value->by;
  }
  return found;
}

}  // namespace

ConditionNames::ConditionNames(Index m, const std::vector<std::string>& x, Index n, const std::vector<std::string>& y,
                               const std::vector<std::string>& all)
    : variables(variables_of('x', m, x, n, y)), states(m), constraints(n), memories(Index(all.size())) {
  for (std::size_t k = 0; k < all.size(); ++k)
    if (can_be_variable(all[k])) variables.emplace(all[k], std::size_t(m + n) + k);
}

Memory::Condition read_condition(const std::string& text, const ConditionNames& names, const Expressions& expressions,
                                 double T, const std::string& where, SwitchTimes& switches) {
  const std::optional<Sides> sides = sides_of(text);
  if (!sides) throw Error(where, "found " + in_quotes(text), example);
  const std::string difference = fmt::format("({}) - ({})", sides->larger, sides->smaller);
  const auto slopes = slopes_of(expressions.formula(difference, names.variables, where), T);
  if (!slopes)
    throw Error(where, in_quotes(text) + " is not affine in x and y",
                "compare sums of states, y and modes of memories with constant factors, and functions of t");
  Memory::Condition condition;
  for (const auto& [k, slope] : *slopes) {
    if (slope == 0) continue;
    const Index number = Index(k), m = names.states, n = names.constraints;
    const bool of_y = number >= m && number < m + n;
    Vector& into = of_y ? condition.y : condition.x;
    if (into.size() == 0) into = Vector::Zero(of_y ? n : m + names.memories);
    into[of_y ? number - m : number < m ? number : number - n] = slope;
  }
  const std::string of_time =
      expressions.in_full(with_names_replaced(difference,
                                              [&](const std::string& name, std::string& by) {
                                                by = "0";
                                                return names.variables.contains(name) && !expressions.has(name);
                                              }),
                          where);
  condition.time = expressions.in_time({of_time});
  switches = expressions.switch_times({of_time}, T);
  return condition;
}

}  // namespace bromwich

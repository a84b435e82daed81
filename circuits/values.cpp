#include "circuits/values.hpp"

#include "core/base/error.hpp"
#include "files/scene_file.hpp"

#include <fmt/format.h>

#include <array>
#include <cctype>
#include <charconv>
#include <cmath>

namespace bromwich::circuits {

namespace {

bool letter(char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0 || c == '_'; }
bool digit(char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; }

struct Suffix {
  const char* word;
  int exponent;  ///< of ten
};
// "meg" before "m". A mil is 25.4 um.
constexpr std::array<Suffix, 12> suffixes{{{"meg", 6},
                                           {"t", 12},
                                           {"g", 9},
                                           {"k", 3},
                                           {"m", -3},
                                           {"u", -6},
                                           {"\xc2\xb5", -6},
                                           {"\xce\xbc", -6},
                                           {"\xb5", -6},
                                           {"n", -9},
                                           {"p", -12},
                                           {"f", -15}}};

double value_of(const std::string& digits) {
  double value = NAN;
  std::from_chars(digits.data(), digits.data() + digits.size(), value);
  return value;
}

// The length of the number at the begin of `s`, and its value; 0 if there is none. 10u is the double next to 1e-5.
std::size_t number_at(const std::string& s, double& value) {
  const char* begin = s.data();
  const auto [end, failure] = std::from_chars(begin, begin + s.size(), value);
  if (failure != std::errc() || !std::isfinite(value)) return 0;
  std::size_t length = std::size_t(end - begin);
  std::string digits = s.substr(0, length);
  if (s.compare(length, 3, "mil") == 0) {
    value *= 25.4e-6;
    length += 3;
  } else {
    for (const Suffix& suffix : suffixes) {
      const std::string word = suffix.word;
      if (s.compare(length, word.size(), word) != 0) continue;
      length += word.size();
      // 4k7: digits behind the suffix are decimals.
      if (digits.find('.') == std::string::npos) {
        digits += '.';
        while (length < s.size() && digit(s[length])) digits += s[length++];
      }
      value = digits.find('e') == std::string::npos ? value_of(digits + "e" + std::to_string(suffix.exponent))
                                                    : value * std::pow(10.0, suffix.exponent);
      break;
    }
  }
  while (length < s.size() && letter(s[length])) ++length;  // the unit
  return length;
}

std::string spelled(double value) { return fmt::format("({:.17g})", value); }

// The arguments of a call whose '(' is at `open`; `end`: behind its ')'.
std::vector<std::string> call_arguments(const std::string& s, std::size_t open, std::size_t& end, const Place& place) {
  std::vector<std::string> arguments(1);
  int depth = 0;
  for (std::size_t i = open; i < s.size(); ++i) {
    if (s[i] == '(' && depth++ == 0) continue;
    if (s[i] == ')' && --depth == 0) {
      end = i + 1;
      return arguments;
    }
    if (s[i] == ',' && depth == 1)
      arguments.emplace_back();
    else
      arguments.back() += s[i];
  }
  throw Error(to_string(place), fmt::format("'(' has no ')' in '{}'", s), "close it");
}

}  // namespace

std::optional<double> spice_number(const std::string& word) {
  double value = 0;
  std::string s = lower(word);
  const bool plus = !s.empty() && s[0] == '+';
  if (plus) s.erase(0, 1);
  const std::size_t length = number_at(s, value);
  if (length == 0 || length != s.size() || (plus && !s.empty() && s[0] == '-')) return std::nullopt;
  return value;
}

bool is_number(const std::string& word) { return spice_number(word) || without_braces(word) != word; }

std::string without_braces(const std::string& s) {
  if (s.size() >= 2 && ((s.front() == '{' && s.back() == '}') || (s.front() == '\'' && s.back() == '\'') ||
                        (s.front() == '"' && s.back() == '"')))
    return s.substr(1, s.size() - 2);
  return s;
}

void Parameters::define(const std::string& name, const std::string& expression, const Place& place) {
  definitions_[name] = {without_braces(expression), place};
}

void Parameters::set(const std::string& name, double value) { definitions_[name] = {spelled(value), {}, value}; }

void Parameters::define_function(const std::string& name, std::vector<std::string> arguments,
                                 const std::string& expression) {
  functions_[name] = {std::move(arguments), without_braces(expression)};
}

const Parameters::Definition* Parameters::find(const std::string& name, const Parameters*& scope) const {
  for (scope = this; scope; scope = scope->outer_)
    if (const auto found = scope->definitions_.find(name); found != scope->definitions_.end()) return &found->second;
  return nullptr;
}

const Parameters::Function* Parameters::find_function(const std::string& name) const {
  for (const Parameters* scope = this; scope; scope = scope->outer_)
    if (const auto found = scope->functions_.find(name); found != scope->functions_.end()) return &found->second;
  return nullptr;
}

bool Parameters::has(const std::string& name) const { return definitions_.contains(name); }

double Parameters::of(const Definition& d) const {
  if (d.value) return *d.value;
  if (d.open)
    throw Error(to_string(d.place), fmt::format("the parameter '{}' is defined by itself", d.expression),
                "define it by others");
  d.open = true;
  d.value = constant_expression(plain(d.expression, d.place), {}, to_string(d.place));
  d.open = false;
  return *d.value;
}

std::map<std::string, double> Parameters::values() const {
  std::map<std::string, double> all;
  for (const auto& [name, definition] : definitions_) all[name] = of(definition);
  return all;
}

double Parameters::value(const std::string& word, const Place& place, const std::string& what) const {
  if (const auto number = spice_number(word)) return *number;
  const std::string inner = without_braces(word);
  const Parameters* scope = nullptr;
  if (inner == word && !find(word, scope))
    throw Error(to_string(place), fmt::format("{}: '{}' is neither a number nor a parameter", what, word),
                "give a number such as 10u, or an expression in braces");
  return constant_expression(plain(inner, place), {}, to_string(place) + ": " + what);
}

std::string Parameters::plain(const std::string& s, const Place& place, int depth) const {
  if (depth > 50) throw Error(to_string(place), fmt::format("'{}' calls itself", s), "define it by other functions");
  std::string out;
  for (std::size_t i = 0; i < s.size();) {
    if (digit(s[i]) || (s[i] == '.' && i + 1 < s.size() && digit(s[i + 1]))) {
      double value = 0;
      const std::size_t length = number_at(s.substr(i), value);
      if (length == 0)
        throw Error(to_string(place), fmt::format("'{}' has a number that is too large or too small", s),
                    "give numbers that a double holds");
      i += length;
      out += spelled(value);
    } else if (letter(s[i])) {
      std::size_t end = i;
      while (end < s.size() && (letter(s[end]) || digit(s[end]) || s[end] == '.')) ++end;
      const std::string name = s.substr(i, end - i);
      const std::size_t open = s.find_first_not_of(' ', end);
      const bool call = open != std::string::npos && s[open] == '(';
      const Parameters* scope = nullptr;
      if (const Definition* d = call ? nullptr : find(name, scope)) {
        out += d->argument ? "(" + d->expression + ")" : spelled(scope->of(*d));
      } else if (const Function* f = call ? find_function(name) : nullptr) {
        std::vector<std::string> arguments = call_arguments(s, open, end, place);
        if (arguments.size() != f->arguments.size())
          throw Error(to_string(place),
                      fmt::format("{} takes {} arguments, found {}", name, f->arguments.size(), arguments.size()),
                      "correct the call");
        Parameters inner(this);
        for (std::size_t k = 0; k < arguments.size(); ++k)
          inner.definitions_[f->arguments[k]] = {plain(arguments[k], place, depth + 1), place, {}, false, true};
        out += "(" + inner.plain(f->expression, place, depth + 1) + ")";
      } else if (call && name == "if") {
        const std::vector<std::string> a = call_arguments(s, open, end, place);
        if (a.size() != 3) throw Error(to_string(place), "if takes 3 arguments", "write if(a>b, x, y)");
        out += fmt::format("(({}) ? ({}) : ({}))", plain(a[0], place, depth + 1), plain(a[1], place, depth + 1),
                           plain(a[2], place, depth + 1));
      } else {
        out += name == "ln" ? "log" : name;
      }
      i = end;
    } else if (s[i] == '*' && i + 1 < s.size() && s[i + 1] == '*') {
      out += '^';
      i += 2;
    } else {
      out += s[i++];
    }
  }
  return out;
}

}  // namespace bromwich::circuits

#include "files/spelling.hpp"

#include "core/base/error.hpp"
#include "files/names.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <string_view>
#include <utility>

namespace bromwich {

namespace {

/// Words of other languages, and what is written here.
struct Spelling {
  std::string_view word;
  std::string_view remedy;
};

constexpr auto spellings = std::to_array<Spelling>({
    {"if", "write condition ? value : other"},
    {"ifelse", "write condition ? value : other"},
    {"where", "write condition ? value : other"},
    {"else", "write condition ? value : other"},
    {"and", "write && between conditions"},
    {"or", "write || between conditions"},
    {"not", "write (condition) == 0"},
    {"np", "write functions without 'np.'"},
    {"numpy", "write functions without 'numpy.'"},
    {"math", "write functions without 'math.'"},
    {"e", "write exp(1)"},
    {"time", "write t"},
});

/// Signs of print, and what is written here.
constexpr auto printed = std::to_array<std::pair<std::string_view, std::string_view>>({
    {"\u2212", "-"},
    {"\u2013", "-"},
    {"\u00b7", "*"},
    {"\u00d7", "*"},
    {"\u00f7", "/"},
    {"\u00b2", "^2"},
    {"\u00b3", "^3"},
    {"\u03c0", "pi"},
    {"\u221e", "a finite number"},
});

bool is_digit(char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; }
bool is_letter(char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0 || c == '_'; }

std::size_t end_of_name(const std::string& text, std::size_t i) {
  while (i < text.size() && (is_letter(text[i]) || is_digit(text[i]))) ++i;
  return i;
}

std::size_t end_of_number(const std::string& text, std::size_t i) {
  while (i < text.size() && (is_digit(text[i]) || text[i] == '.')) ++i;
  std::size_t exponent = i;
  if (exponent < text.size() && std::tolower(static_cast<unsigned char>(text[exponent])) == 'e') ++exponent;
  if (exponent > i && exponent < text.size() && (text[exponent] == '+' || text[exponent] == '-')) ++exponent;
  if (exponent == i || exponent >= text.size() || !is_digit(text[exponent])) return i;
  while (exponent < text.size() && is_digit(text[exponent])) ++exponent;
  return exponent;
}

/// Refuses a number with letters behind it: 2t for a product, 1k for a factor.
void check_numbers(const std::string& text, const std::string& where) {
  std::size_t i = 0;
  while (i < text.size()) {
    if (is_letter(text[i])) {
      i = end_of_name(text, i);
    } else if (is_digit(text[i]) || (text[i] == '.' && i + 1 < text.size() && is_digit(text[i + 1]))) {
      const std::size_t begin = i;
      i = end_of_number(text, i);
      const std::size_t name = std::min(text.find_first_not_of(" \t", i), text.size());
      const std::size_t end = name < text.size() && is_letter(text[name]) ? end_of_name(text, name) : name;
      const std::string word = text.substr(name, end - name);
      const bool of_another_language =
          std::any_of(spellings.begin(), spellings.end(), [&](const Spelling& s) { return s.word == word; });
      if (!word.empty() && !of_another_language)
        throw Error(where, in_quotes(text) + fmt::format(" has '{}'", text.substr(begin, end - begin)),
                    "write a product with *, and factors such as k and m as 1e3 and 1e-3");
    } else {
      ++i;
    }
  }
}

}  // namespace

void check_signs(const std::string& text, const std::string& where) {
  if (one_line(text).empty()) throw Error(where, "found an empty expression", "write a number or an expression");
  for (const auto& [sign, ours] : printed)
    if (text.find(sign) != std::string::npos)
      throw Error(where, in_quotes(text) + fmt::format(" has '{}'", sign), fmt::format("write {}", ours));
  check_numbers(text, where);
  int depth = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    depth += int(text[i] == '(') - int(text[i] == ')');
    if (text[i] == ',' && depth <= 0)
      throw Error(where, in_quotes(text) + " has a comma outside of a function", "write decimals with a point");
    const char next = i + 1 < text.size() ? text[i + 1] : ' ';
    if (text[i] == '*' && next == '*') throw Error(where, in_quotes(text) + " has '**'", "write a power with ^");
    if (text[i] == '%') throw Error(where, in_quotes(text) + " has '%'", "write a remainder as mod(a, b)");
    if ((text[i] == '&' || text[i] == '|') && next != text[i] && (i == 0 || text[i - 1] != text[i]))
      throw Error(where, in_quotes(text) + fmt::format(" has a single '{}'", text[i]),
                  fmt::format("write {0}{0}", text[i]));
    if (text[i] != '=') continue;
    const bool compares = i > 0 && std::string_view("<>!").find(text[i - 1]) != std::string_view::npos;
    const bool doubled = next == '=';
    if (!compares && !doubled) throw Error(where, in_quotes(text) + " assigns with '='", "compare with ==");
    i += std::size_t(doubled);
  }
}

void check_spelling(const std::string& text, const std::string& name, const std::string& where) {
  for (const auto& [word, remedy] : spellings)
    if (name == word)
      throw Error(where, in_quotes(text) + fmt::format(" uses '{}', which has no meaning here", name),
                  std::string(remedy));
}

}  // namespace bromwich

#include "files/spelling.hpp"

#include "core/base/error.hpp"
#include "files/names.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <array>
#include <string_view>

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

}  // namespace

void check_signs(const std::string& text, const std::string& where) {
  if (one_line(text).empty()) throw Error(where, "found an empty expression", "write a number or an expression");
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

#include "files/names.hpp"

#include "files/words.hpp"

#include <algorithm>
#include <cctype>

namespace bromwich {

namespace {

bool begins_name(char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0 || c == '_'; }
bool is_digit(char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; }
bool continues_name(char c) { return begins_name(c) || is_digit(c); }

/// The end of the number that starts at `begin`: the e in "2.5e-3" is not a name.
std::size_t skip_number(std::string_view text, std::size_t begin) {
  const auto digits = [&](std::size_t i) {
    while (i < text.size() && (is_digit(text[i]) || text[i] == '.')) ++i;
    return i;
  };
  const std::size_t end = digits(begin);
  if (end >= text.size() || (text[end] != 'e' && text[end] != 'E')) return end;
  std::size_t exponent = end + 1;
  if (exponent < text.size() && (text[exponent] == '+' || text[exponent] == '-')) ++exponent;
  return digits(exponent) > exponent ? digits(exponent) : end;
}

}  // namespace

bool is_name(std::string_view text) {
  return !text.empty() && begins_name(text[0]) && std::all_of(text.begin(), text.end(), continues_name);
}

std::vector<Name> names_in(std::string_view text) {
  std::vector<Name> names;
  for (std::size_t i = 0; i < text.size();) {
    if (is_digit(text[i]) || text[i] == '.') {
      i = skip_number(text, i);
    } else if (begins_name(text[i])) {
      std::size_t end = i;
      while (end < text.size() && continues_name(text[end])) ++end;
      const std::size_t next = text.find_first_not_of(" \t", end);
      names.push_back({std::string(text.substr(i, end - i)), i, next != std::string_view::npos && text[next] == '('});
      i = end;
    } else {
      ++i;
    }
  }
  return names;
}

std::string with_names_replaced(std::string_view text,
                                const std::function<bool(const std::string& name, std::string& by)>& replacement) {
  std::string replaced, by;
  std::size_t copied = 0;
  for (const Name& name : names_in(text)) {
    if (name.called || !replacement(name.text, by)) continue;
    replaced.append(text.substr(copied, name.begin - copied)).append(by);
    copied = name.begin + name.text.size();
  }
  return replaced.append(text.substr(copied));
}

std::string in_quotes(std::string_view text) {
  constexpr std::size_t longest = 60;
  const std::string line = one_line(text);
  return line.size() <= longest ? "'" + line + "'" : "'" + line.substr(0, longest) + "...'";
}

}  // namespace bromwich

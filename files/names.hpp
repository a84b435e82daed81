#pragma once
// Names in the text of an expression.

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace bromwich {

/// A name of letters, digits and _ that does not begin with a digit.
bool is_name(std::string_view text);

struct Name {
  std::string text;
  std::size_t begin = 0;  ///< its place in the expression
  bool called = false;    ///< a parenthesis follows
};

/// In their order; the e of "2.5e-3" is none.
std::vector<Name> names_in(std::string_view text);

/// The text with other text in place of names: `replacement` is called for every name that is not a function call and
/// writes it, or returns false to keep the name.
std::string with_names_replaced(std::string_view text,
                                const std::function<bool(const std::string& name, std::string& by)>& replacement);

/// For messages: the text in quotes, on one line, cut after 60 characters.
std::string in_quotes(std::string_view text);

}  // namespace bromwich

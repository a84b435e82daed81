#pragma once
// Signs and words of other languages in expressions: each is refused, with what is written here.

#include <string>

namespace bromwich {

/// Throws Error, naming `where`, for texts with another meaning in muParser: "a = 2" assigns, "1,5" has two values.
void check_signs(const std::string& text, const std::string& where);
/// The same for a name that has a meaning in other languages but none here.
void check_spelling(const std::string& text, const std::string& name, const std::string& where);

}  // namespace bromwich

#pragma once
// Formatted text for reasons, descriptions and errors.

#include <cstdarg>
#include <string>

namespace bromwich {

/// The text that printf would print.
[[gnu::format(printf, 1, 2)]] std::string text(const char* format, ...);
/// The text that vprintf would print.
[[gnu::format(printf, 1, 0)]] std::string text(const char* format, std::va_list values);

}  // namespace bromwich

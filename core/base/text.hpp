#pragma once
// Formatted text for reasons, descriptions and errors.

#include <string>

namespace bromwich {

/// The text that printf would print.
[[gnu::format(printf, 1, 2)]] std::string text(const char* format, ...);

}  // namespace bromwich

#pragma once
// Words with numbers in them, for reasons, descriptions and errors.

#include <string>

namespace bromwich {

/// What printf would print.
[[gnu::format(printf, 1, 2)]] std::string text(const char* format, ...);

}  // namespace bromwich

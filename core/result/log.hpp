#pragma once

#include "bromwich/options.hpp"

namespace bromwich {

/// Sends the text that printf would print.
[[gnu::format(printf, 3, 4)]] void note(const Log&, LogLevel, const char* format, ...);

}  // namespace bromwich

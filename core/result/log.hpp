#pragma once
// What a solve decides on its way, for whoever wants to know: Options::log receives it.

#include <functional>
#include <string>

namespace bromwich {

enum class LogLevel {
  debug,    ///< how a decision is carried out
  info,     ///< decisions: methods, grids, solves for confirmation
  warning,  ///< what Result::warning says
};

struct LogEntry {
  LogLevel level = LogLevel::info;
  std::string text;  ///< one line
};

/// Called from the thread that called `solve`; empty: nothing is logged, and no text is made.
using Log = std::function<void(const LogEntry&)>;

/// Sends the text that printf would print.
[[gnu::format(printf, 3, 4)]] void note(const Log&, LogLevel, const char* format, ...);

}  // namespace bromwich

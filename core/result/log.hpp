#pragma once
// Messages about the decisions of a solve, for Options::log.

#include <functional>
#include <string>

namespace bromwich {

enum class LogLevel {
  debug,    ///< how a decision is carried out
  info,     ///< decisions: methods, grids, solves for confirmation
  warning,  ///< the text of Result::warning
};

struct LogEntry {
  LogLevel level = LogLevel::info;
  std::string text;  ///< one line
};

/// Called from the thread that called `solve`; if it is empty, no text is made.
using Log = std::function<void(const LogEntry&)>;

/// Sends the text that printf would print.
[[gnu::format(printf, 3, 4)]] void note(const Log&, LogLevel, const char* format, ...);

}  // namespace bromwich

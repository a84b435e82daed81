#include "app/log.hpp"

#include "app/text.hpp"
#include "core/base/error.hpp"

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

namespace bromwich::app {

namespace {

spdlog::level::level_enum level_of(LogLevel level) {
  switch (level) {
    case LogLevel::debug:
      return spdlog::level::debug;
    case LogLevel::info:
      return spdlog::level::info;
    case LogLevel::warning:
      break;
  }
  return spdlog::level::warn;
}

}  // namespace

Log make_log(const std::string& level, std::function<void()> before_line) {
  const std::vector<std::string> known{"off", "warning", "info", "debug"};
  if (std::find(known.begin(), known.end(), level) == known.end())
    throw Error("--log-level", "found '" + level + "'" + suggestion(level, known), "use one of " + join(known));
  if (level == "off") return {};
  auto logger = std::make_shared<spdlog::logger>("bromwich", std::make_shared<spdlog::sinks::stderr_color_sink_st>());
  logger->set_level(spdlog::level::from_str(level));
  logger->set_pattern("%H:%M:%S.%e %^%l%$: %v");
  logger->flush_on(spdlog::level::debug);
  return [logger, before_line = std::move(before_line)](const LogEntry& entry) {
    if (!logger->should_log(level_of(entry.level))) return;
    if (before_line) before_line();
    logger->log(level_of(entry.level), "{}", one_line(entry.text));
  };
}

}  // namespace bromwich::app

#pragma once
// Log lines on standard error, by spdlog: what a solve decides.

#include "core/result/log.hpp"

#include <string>

namespace bromwich::app {

/// What receives the lines of this level and above: "off" (an empty Log), "warning", "info" or "debug". Throws Error
/// for another word, and in a build without spdlog for any level but "off".
/// `before_line` is called before every line, to take a progress line away.
Log make_log(const std::string& level, std::function<void()> before_line);

}  // namespace bromwich::app
